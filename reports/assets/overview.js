// The first page: the stage with its counters, the race at an error, the heat map's modes and its drawer.
(async () => {
  const MBS = window.MBS, data = await MBS.unpack(MBS.overview);
  const $ = (s, from = document) => from.querySelector(s), $$ = (s, from = document) => [...from.querySelectorAll(s)], make = MBS.element;
  const state = { race: data.first, target: data.target, mode: "limit" };

  // the stage
  const canvas = $("[data-stage]"), small = data.stages.map((s) => s.small && MBS.stage(s.small));
  if (canvas) {
    const cast = $("[data-cast]"), minis = $$("[data-mini]"), loaded = {}, stage = MBS.scene(canvas, cast);
    const load = (k) => new Promise((done) => {
      const { file } = data.stages[k];
      if (MBS[file]) return done();
      document.body.append(make("script", { src: `data/${file}.js`, onload: done }));
    });
    const show = async (k, asked = true) => {
      const s = data.stages[k];
      await load(k);
      loaded[k] ||= MBS.stage(await MBS.unpack(MBS[s.file]));
      minis.forEach((b, i) => b.setAttribute("aria-pressed", i === k));
      if (k !== show.now) cast.replaceChildren(...s.said.map((r) => make("li", { className: r.kind },
        make("a", { className: "solver", href: r.url, style: `--c: ${data.colours[r.solver]}` }, r.solver), " ", make("small", {}, `${r.code && `${r.code}, `}${r.words}, ${r.step}`), MBS.element("b", {}, "–"),
        make("span", {}, `claimed: ${r.claimed} · measured: `, make("b", { className: `mark ${r.kind}` }, r.measured)), ...(r.why ? [make("small", { className: "why" }, r.why)] : []))));
      $$("li > b", cast).forEach((b) => b.setAttribute("data-off", ""));
      show.now = k;
      Object.assign($("[data-problem]"), { textContent: s.problem, href: `problem-${s.slug}.html` });
      stage.show(loaded[k]);
      if (!asked) return;
      const race = data.costs.findIndex((r) => r.slug === s.slug), same = data.costs.findIndex((r) => r.problem === s.problem);
      if (race >= 0 || same >= 0) choose(race >= 0 ? race : same);
    };
    show.now = 0;
    minis.forEach((b, k) => b.addEventListener("click", () => show(k)));
    MBS.onStage = { seek: stage.seek, show, play: stage.play };
    let frame = 0;
    const drawMinis = () => minis.forEach((b, k) => { if (small[k]) MBS.paint($("canvas", b), small[k], frame % small[k].frames, true); });
    const near = new IntersectionObserver(([e]) => { clearInterval(near.timer); if (e.isIntersecting && !MBS.quiet) near.timer = setInterval(() => { frame += 1; drawMinis(); }, 70); });
    near.observe(canvas);
    MBS.onTheme(drawMinis);
    drawMinis();
    show(0, false);
  }

  // the race: at an error, on a problem
  const bars = $("[data-bars]"), slider = $("[data-target]"), on = $("[data-on]");
  const lit = (name) => { const { over, pinned } = lit.now; return !over && !pinned.length ? null : over === name || pinned.includes(name); };
  lit.now = { over: "", pinned: [] };
  const race = () => {
    if (!bars) return;
    const r = data.costs[state.race], k = (state.target = Math.min(state.target, r.targets.length - 1));
    Object.assign(slider, { max: r.targets.length - 1, value: k, ariaValueText: r.words[k] });
    $("[data-wanted]").textContent = r.words[k];
    $("[data-command]").textContent = r.command[k];
    $("[data-say]").textContent = `${r.answers[k]}.`;
    const all = Object.entries(r.solvers), there = all.filter(([, s]) => s.cpu[k] !== null).sort((a, b) => a[1].cpu[k] - b[1].cpu[k]);
    const [low, high] = [there[0][1].cpu[k] / 2, Math.max(there[there.length - 1][1].cpu[k], there[0][1].cpu[k] * 10)];
    const rest = all.filter(([, s]) => s.cpu[k] === null).sort((a, b) => (a[0] < b[0] ? -1 : 1));
    bars.replaceChildren(...[...there, ...rest].map(([name, s]) => {
      const cpu = s.cpu[k], item = make("li", { className: cpu === null ? "missed" : "", style: `--c: ${data.colours[name]}; --w: ${cpu === null ? 0 : (100 * Math.log(cpu / low)) / Math.log(high / low)}%` },
        make("a", { href: s.url }, name), make("i", {}), make("span", {}, cpu === null ? s.why : `${s.bound[k] ? "≤ " : ""}${s.shown[k]} ×${MBS.number(s.factor[k], 2)}`));
      item.dataset.solver = name;
      return item;
    }));
    light();
  };
  const choose = (k) => { state.race = k; on.value = k; race(); heat(); };
  if (bars) {
    on.addEventListener("change", () => choose(Number(on.value)));
    slider.addEventListener("input", () => { state.target = Number(slider.value); race(); heat(); });
    $("[data-copy]").addEventListener("click", async (e) => { try { await navigator.clipboard.writeText($("[data-command]").textContent); e.target.textContent = "copied"; } catch { getSelection().selectAllChildren($("[data-command]")); } });
  }

  // one solver lights everywhere
  const light = () => {
    for (const e of $$("[data-bars] li, .heat tbody tr, .follow circle")) {
      const is = lit(e.dataset.solver);
      e.classList.toggle("lit", is === true);
      e.classList.toggle("dim", is === false);
    }
  };
  document.addEventListener("mbs-solver", (e) => { lit.now = e.detail; light(); });
  for (const box of $$("[data-bars], .heat tbody, .strips")) {
    box.addEventListener("pointerover", (e) => MBS.hover?.(e.target.closest("[data-solver]")?.dataset.solver || ""));
    box.addEventListener("pointerleave", () => MBS.hover?.(""));
  }

  // the heat map: three modes, sorted by a column, a drawer a cell
  const table = $("table.heat");
  const rows = table ? $$("tbody tr", table) : [], heads = table ? $$("thead th", table) : [], slugs = heads.map((h) => h.dataset.slug);
  const kept = rows.map((row) => [...row.cells].map((c) => ({ kind: c.className, html: c.innerHTML })));
  const level = (edges, v) => edges.filter((e) => v > e).length;
  const heat = () => {
    if (!table) return;
    const title = $("[data-heat-title]"), words = $("[data-mode-words]"), wanted = data.costs[state.race]?.targets[state.target];
    $$("[data-mode]").forEach((b) => b.setAttribute("aria-pressed", b.dataset.mode === state.mode));
    title.dataset.own ||= title.textContent;
    words.dataset.own ||= words.textContent;
    $(".heatkey").hidden = state.mode !== "limit";
    let reached = 0, count = 0;
    rows.forEach((row, i) => [...row.cells].forEach((cell, k) => {
      if (!slugs[k]) { if (k) cell.hidden = state.mode !== "limit"; return; }
      if (state.mode === "limit") { cell.className = kept[i][k].kind; cell.innerHTML = kept[i][k].html; cell.dataset.v = data.cells[`${row.dataset.solver} ${slugs[k]}`] ? cell.textContent.trim() : ""; return; }
      const cost = data.costs.find((c) => c.slug === slugs[k]), s = cost?.solvers[row.dataset.solver], at = cost ? cost.targets.indexOf(wanted) : -1;
      let kind = "none", text = "·", said = "no comparison here", v = "";
      if (s && at >= 0) {
        count += 1;
        const first = Math.min(...Object.values(cost.solvers).map((o) => o.cpu[at]).filter((c) => c !== null));
        if (state.mode === "error") {
          if (s.cpu[at] !== null) { reached += 1; kind = `h${level([1.0001, 2, 5, 10, 30, 100], s.factor[at])}`; text = `×${MBS.number(s.factor[at], 2)}`; v = s.factor[at]; said = `${s.shown[at]}, ${text} the cheapest, for ${cost.words[at]}`; }
          else { kind = "refused"; text = "–"; said = s.why; }
        } else {
          const best = s.points.filter(([c]) => c <= 10 * first).map(([, e]) => e).sort((a, b) => a - b)[0];
          if (best !== undefined) { reached += 1; const part = best / wanted; kind = `h${level([1e-4, 1e-2, 1, 10, 100, 1000], part)}`; text = MBS.number(best, 1); v = best; said = `error ${MBS.number(best)} ${cost.unit} within ten times the cheapest CPU time for ${cost.words[at]}`; }
          else { kind = "refused"; text = "–"; said = "no run within ten times the cheapest CPU time"; }
        }
      }
      cell.className = kind;
      cell.dataset.v = v;
      cell.replaceChildren(make("a", { href: s ? s.url : "#heat", title: `${row.dataset.solver}: ${said}`, ariaLabel: `${row.dataset.solver}: ${said}` }, text));
    }));
    if (heads.length) heads[heads.length - 1].hidden = state.mode !== "limit";
    const asked = data.costs[state.race]?.words[state.target];
    title.textContent = state.mode === "limit" ? title.dataset.own : state.mode === "error" ? `${reached} of ${count} pairs of solver and problem reach ${asked}` : `${reached} of ${count} pairs have a run within ten times the cheapest CPU time for ${asked}`;
    words.textContent = state.mode === "limit" ? words.dataset.own : state.mode === "error" ? `CPU time over that of the cheapest at ${asked}; the slider above sets the error.` : `Smallest error within ten times the CPU time of the cheapest for ${asked}.`;
  };
  $$("[data-mode]").forEach((b) => b.addEventListener("click", () => { state.mode = b.dataset.mode; heat(); }));
  if (table) {
    MBS.sorters(heads.filter((h) => slugs[heads.indexOf(h)]), (head) => { const b = make("button", { type: "button", className: "sorter", textContent: "sort" }); b.setAttribute("aria-label", `Sort by ${head.textContent}`); return b; }, (column, up) => {
      const k = heads.indexOf(heads.filter((h) => slugs[heads.indexOf(h)])[column]), value = (row) => (state.mode === "limit" ? number(row.cells[k].textContent) : row.cells[k].dataset.v);
      table.tBodies[0].append(...[...rows].sort((a, b) => MBS.ordered(value(a), value(b), up)));
    });
    const number = (text) => { const m = text.match(/(\d[\d.]*)(?:×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?/); if (!m || /[★⊘…·]/.test(text)) return ""; const p = m[2] ? Number([...m[2]].map((c) => "-0123456789"["⁻⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(c)]).join("")) : 0; return Number(m[1]) * 10 ** p; };
    const drawer = $("[data-drawer]");
    const strip = (s) => {
      const [t, y] = [MBS.numbers(s.t), MBS.numbers(s.y)], above = y.filter((v) => v > 0);
      if (!above.length) return make("small", {}, "energy error: zero throughout");
      const [lo, hi] = [Math.log10(Math.min(...above)), Math.log10(Math.max(...above))], end = t[t.length - 1] || 1;
      const d = t.map((v, k) => `${k ? "L" : "M"}${((260 * v) / end).toFixed(1)} ${(40 - 36 * ((y[k] > 0 ? Math.log10(y[k]) - lo : 0) / (hi - lo || 1))).toFixed(1)}`).join("");
      const box = document.createElement("div");
      box.innerHTML = `<svg viewBox="0 0 260 44" role="img" aria-label="Energy error over time, logarithmic"><path d="${d}" fill="none" stroke="currentColor" stroke-width="1.5"/></svg>`;
      box.append(make("small", {}, `energy error over ${MBS.number(end, 2)} s, ${MBS.number(Math.min(...above), 1)} to ${MBS.number(Math.max(...above), 2)} J`));
      return box;
    };
    table.addEventListener("click", (e) => {
      const cell = e.target.closest("tbody td"), row = e.target.closest("tr");
      if (!cell || !row || e.ctrlKey || e.metaKey) return;
      const slug = slugs[cell.cellIndex], about = data.cells[`${row.dataset.solver} ${slug}`];
      if (!about) return;
      e.preventDefault();
      const k = data.stages.findIndex((s) => s.slug === slug || s.slug.split("-")[0] === slug.split("-")[0]), picture = small[k] ? make("canvas", {}) : "";
      drawer.replaceChildren(make("button", { type: "button", textContent: "✕", ariaLabel: "Close", className: "close", onclick: () => { drawer.hidden = true; } }), picture,
        make("p", {}, about.words), ...(about.strip ? [strip(about.strip)] : []),
        make("dl", {}, ...about.facts.flatMap(([a, b]) => [make("dt", {}, a), make("dd", {}, b)])), make("code", {}, about.command), make("p", {}, make("a", { href: about.url }, "Page of this run")));
      drawer.className = `drawer ${about.kind}`;
      drawer.hidden = false;
      if (picture) MBS.paint(picture, small[k], Math.floor(small[k].frames / 3), true);
    });
  }
  race();
  heat();
  MBS.first = { state, data, choose, heat };
})();
