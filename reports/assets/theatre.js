// The theatre's clock and controls: one time for the stage, the strips and the table. Runs are side by side, or in one cell.
(async () => {
  const T = MBS.theatre, root = document.querySelector("[data-theatre]"), name = root.dataset.theatre;
  const play = MBS[name] = await MBS.unpack(MBS[name]);
  const find = (name) => root.querySelector(`[data-${name}]`), asked = new URLSearchParams(location.hash.slice(1));

  // runs that a visitor added: in the address, each from a file of its own, with a row like that of the first
  const add = find("add"), added = (asked.get("add") || "").split(",").filter((id) => add && [...add.options].some((o) => id && o.value === id));
  for (const id of added) {
    await new Promise((onload, onerror) => document.head.append(MBS.element("script", { src: `data/${name}-${id}.js`, onload, onerror })));
    const p = await MBS.unpack(MBS[`${name}-${id}`]), first = root.querySelector("[data-player]"), row = first.cloneNode(true);
    p.marks.forEach((m) => { m.player = play.players.length; });
    play.players.push(p);
    const [show, solid] = row.querySelectorAll("input"), setting = row.querySelector(".setting"), line = setting.querySelector(".line");
    Object.assign(show, { checked: true, ariaLabel: `Show ${p.solver}, ${p.settings}` });
    Object.assign(solid, { checked: false, ariaLabel: `Draw ${p.solver}, ${p.settings} solid` });
    Object.assign(line, { className: `line r${p.rank}` }).style.setProperty("--c", p.colour);
    setting.replaceChildren(line, `${p.solver} `, MBS.element("a", { href: `runs/${p.run}.html` }, p.settings), MBS.element("small", {}, ` ${p.label}`));
    row.cells[3].replaceChildren(p.status.replaceAll("_", " "), MBS.element("small", {}, p.because));
    first.parentElement.append(row);
    if (!root.querySelector(`[data-solver="${CSS.escape(p.solver)}"]`)) {
      const chip = MBS.element("button", { type: "button", ariaPressed: true }, p.solver);
      chip.dataset.solver = p.solver;
      chip.style.setProperty("--c", p.colour);
      root.querySelector(".legend").append(chip);
    }
  }
  add?.addEventListener("change", () => {
    asked.set("add", [...added, add.value].join());
    asked.set("t", state.t);
    location.hash = asked;
    location.reload();
  });
  const players = play.players, players_ = players.map((_, k) => k);
  const canvas = find("canvas"), labels = find("labels"), scrub = find("scrub"), note = find("note");
  const NARROW = 640, LABEL = 22; // [px] of a canvas and its cells
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const state = { t: 0, playing: false, speed: 1, solid: 0, shown: players.map(() => true), trail: "short", together: players.length === 1 || asked.has("overlay") };
  state.solid = Math.max(players.findIndex((p) => p.run === asked.get("solid")), 0);

  const motions = players.map((p) => new T.Motion(p, play));
  const paths = motions.map((m) => m.path(play.trail.body, play.trail.at));
  const heads = motions.map(() => new Float32Array(3));
  const exact = play.exact && new T.Motion(play.exact, play), until = play.exact?.until; // in ink, as far as it is known
  if (exact) { paths.push(exact.path(play.trail.body, play.trail.at)); heads.push(new Float32Array(3)); }
  let dirty = true;
  const moved = () => { dirty = true; wake(); };
  const view = new T.View(canvas, play, moved);
  const driver = asked.has("flat") ? "" : T.webgl(), slow = T.slow(driver);
  const flat = !driver || (slow && !asked.has("solid3d"));
  const stage = flat ? new T.Flat(canvas, play, view) : new T.Solid(canvas, play, view, slow);
  document.querySelector("[data-flat]").hidden = !flat;
  const strips = new T.Strips(find("strips"), find("cursor"), play, (t) => { pause(); seek(t); });

  // names above their cells, where they hide no body; how a run stopped is said there and below the stage
  const names = players.map((p) => {
    const e = MBS.element("span", { title: `${p.solver}, ${p.settings}` }), star = MBS.element("b", { className: "star", hidden: true }, "★ ");
    e.style.setProperty("--c", p.colour);
    e.append(star, p.solver, MBS.element("small", {}, ` ${p.settings}`));
    labels.append(e);
    return e;
  });
  const stopped = find("stops");
  const mark = () => {
    const said = [];
    players.forEach((own, p) => {
      if (state.shown[p] && unknown(p)) said.push(`${own.solver}: its motion between these two stored poses is not known`);
      if (!own.stopped) return;
      const over = state.shown[p] && state.t >= own.last;
      names[p].firstChild.hidden = !over;
      if (over) said.push(`★ ${own.solver}, ${MBS.number(own.last, 4)} s: ${own.status.replaceAll("_", " ")}`);
    });
    if (stopped.textContent !== said.join(" ")) stopped.textContent = said.join(" ");
  };
  let grid = [];
  const divide = () => {
    const box = canvas.getBoundingClientRect(), on = players_.filter((p) => state.shown[p]);
    const each = state.together || !on.length ? [T.order(state.shown, state.solid)] : on.map((p) => [p]);
    const single = each.length === 1 && state.together;
    grid = view.cells(each.length, box.width, box.height, single ? 0 : LABEL).map((c, k) => ({ ...c, players: each[k] }));
    names.forEach((e, p) => {
      const own = single ? null : grid.find((c) => c.players[0] === p);
      e.hidden = !own;
      if (own) Object.assign(e.style, { left: `${own.x}px`, top: `${own.y - LABEL}px`, width: `${own.w}px` });
    });
  };

  // between two stored poses of a run, where its motion is not known
  const unknown = (p) => players[p].unknown.some(([from, to]) => state.t > from && state.t < to);

  // one frame
  const known = () => Boolean(exact) && state.t <= until * (1 + 1e-9);
  const times = new Float64Array(120);
  let frames = 0, before = 0, waiting = 0, shownAt = 0;
  const trailOf = (m, p) => {
    if (!(state.shown[p] ?? known()) || state.trail === "none") return null;
    const back = state.trail === "whole" ? 0 : state.t - play.t_end / 16;
    let from = m.k;
    while (from > 0 && m.t[from] > back) from--;
    return { path: paths[p], from, to: m.k, head: heads[p] };
  };
  const frame = (now) => {
    waiting = 0;
    const began = performance.now();
    if (state.playing) {
      const gone = before ? Math.min((now - before) / 1000, 0.25) : 0;
      state.t = Math.min(state.t + gone * state.speed, play.t_end);
      if (state.t >= play.t_end) pause();
    }
    before = state.playing ? now : 0;
    for (const p of players_) {
      if (!state.shown[p]) continue;
      motions[p].at(state.t);
      motions[p].point(play.trail.body, play.trail.at, heads[p], 0);
    }
    stage.calm(!state.playing && !view.held);
    if (known()) {
      exact.at(state.t);
      exact.point(play.trail.body, play.trail.at, heads[players.length], 0);
    }
    const trails = [...motions, ...(exact ? [exact] : [])].map(trailOf);
    const cells = grid.map((cell) => ({ ...cell, players: cell.players.filter((p) => !unknown(p)) }));
    stage.draw({ motions, exact: known() ? exact : null, cells, solid: state.solid, trails });
    view.point(find("compass"));
    mark();
    if (strips.left(state.t)) {
      strips.stretch(strips.zoom, state.playing ? state.t + 0.45 * strips.span : state.t);
      strips.draw(state.shown, state.solid);
    }
    strips.seek(state.t);
    if (!scrub.matches(":active")) scrub.value = state.t;
    find("time").textContent = clock(state.t);
    if (!state.playing || now - shownAt > 120) { shownAt = now; values(); }
    times[frames++ % times.length] = performance.now() - began;
    dirty = false;
    if (state.playing) wake();
  };
  const wake = () => { waiting ||= requestAnimationFrame(frame); };
  const digits = Math.max(0, Math.min(6, 5 - Math.ceil(Math.log10(play.t_end))));
  const clock = (t) => t.toFixed(digits);
  T.stats = () => {
    const some = times.slice(0, Math.min(frames, times.length)).sort();
    return { frames, script_ms: some[some.length >> 1], script_worst_ms: some[some.length - 1], ...stage.facts(), t: state.t, playing: state.playing };
  };

  // the table: values at the cursor
  const rows = [...root.querySelectorAll("[data-player]")];
  const cells = rows.map((row) => [...row.querySelectorAll("[data-value]")]);
  function values() {
    scrub.setAttribute("aria-valuetext", `${clock(state.t)} s`);
    for (const p of players_) cells[p].forEach((e, s) => { e.textContent = MBS.number(strips.value(p, s, state.t), 2); });
  }

  // moving through time
  const seek = (t) => { state.t = Math.min(Math.max(t, 0), play.t_end); say(); moved(); };
  const playing = find("play");
  const run = (on) => {
    state.playing = on;
    Object.assign(playing, { textContent: on ? "❚❚ Pause" : "▶ Play", ariaPressed: on });
    wake();
  };
  function pause() { run(false); }
  const start = () => {
    if (state.t >= play.t_end) state.t = 0;
    note.textContent = "";
    run(true);
  };
  const toggle = () => (state.playing ? pause() : start());
  playing.addEventListener("click", toggle);
  find("home").addEventListener("click", () => { pause(); seek(0); });
  scrub.max = play.t_end;
  scrub.addEventListener("input", () => { pause(); seek(Number(scrub.value)); });

  const speeds = [0.125, 0.25, 0.5, 1, 2, 4, 8], speed = find("speed");
  const setSpeed = (x) => { state.speed = x; speed.value = x; };
  speed.addEventListener("change", () => setSpeed(Number(speed.value)));
  setSpeed([1, 0.5, 0.25, 0.125].find((x) => play.t_end / x >= 4) ?? 0.125);
  if (play.t_end > 60) setSpeed([2, 4, 8].find((x) => play.t_end / x <= 60) ?? 8);
  const faster = (by) => setSpeed(speeds[Math.min(Math.max(speeds.indexOf(state.speed) + by, 0), speeds.length - 1)]);

  // moments to jump to
  const marks = players.flatMap((p) => p.marks).sort((a, b) => a.t - b.t);
  const words = (m) => `${MBS.number(m.t, 4)} s, ${players[m.player].solver} (${players[m.player].settings}): ${m.words}`;
  function say() {
    const near = marks.filter((m) => Math.abs(m.t - state.t) <= 1e-9 * play.t_end && state.shown[m.player]);
    const first = near.find((m) => m === aimed) || near[0];
    note.textContent = first ? words(first) : "";
  }
  let aimed = null;
  const jump = (m) => {
    aimed = m;
    pause();
    if (!state.shown[m.player]) { state.shown[m.player] = true; changed(); }
    seek(m.t);
  };
  const next = (kind, by = 1) => {
    const all = marks.filter((m) => kind === "*" || m.kind === kind), seen = all.filter((m) => state.shown[m.player]);
    const some = seen.length ? seen : all;
    const beyond = some.filter((m) => (m.t - state.t) * by > 1e-9 * play.t_end);
    const m = by > 0 ? beyond[0] : beyond[beyond.length - 1];
    const to = m || (by > 0 ? some[0] : some[some.length - 1]);
    if (to) jump(to);
  };
  for (const kind of ["stop", "event", "whip"]) {
    const button = find(kind);
    button.disabled = !marks.some((m) => m.kind === kind);
    button.addEventListener("click", () => next(kind));
  }
  const list = find("jump");
  const signs = { stop: "★", event: "◆", whip: "▼" };
  list.options[0].text = marks.length ? "a moment …" : "no moments";
  list.append(...marks.map((m, value) => MBS.element("option", { value }, `${signs[m.kind]} ${words(m)}`.slice(0, 110))));
  list.disabled = !marks.length;
  list.addEventListener("change", () => { if (list.value) jump(marks[Number(list.value)]); list.value = ""; });
  const ticks = find("ticks");
  for (const m of marks) {
    ticks.append(MBS.element("i", { textContent: signs[m.kind], style: `left: ${(100 * m.t) / play.t_end}%; --c: ${players[m.player].colour}` }));
  }

  // who is shown, who is solid
  const chips = [...root.querySelectorAll("[data-solver]")];
  const of = (chip) => players_.filter((p) => players[p].solver === chip.dataset.solver);
  for (const b of chips) {
    b.addEventListener("click", () => {
      const own = of(b), on = !own.some((p) => state.shown[p]);
      own.forEach((p) => { state.shown[p] = on; });
      changed();
    });
  }
  function changed() {
    rows.forEach((row, p) => {
      row.querySelector("[data-show]").checked = state.shown[p];
      row.querySelector("[data-solid]").checked = state.solid === p;
      row.classList.toggle("solid", state.solid === p);
    });
    for (const b of chips) b.setAttribute("aria-pressed", String(of(b).some((p) => state.shown[p])));
    const s = players[state.solid];
    Object.assign(find("who"), { textContent: `Solid: ${s.solver}, ${s.settings}`, hidden: !state.together, style: `--c: ${s.colour}` });
    find("together").ariaPressed = state.together;
    fit();
  }
  function redraw() {
    strips.draw(state.shown, state.solid);
    moved();
  }
  rows.forEach((row, p) => {
    row.querySelector("[data-show]").addEventListener("change", (e) => { state.shown[p] = e.target.checked; changed(); });
    row.querySelector("[data-solid]").addEventListener("change", () => { state.solid = p; state.shown[p] = true; changed(); });
  });
  find("all").addEventListener("click", () => { state.shown.fill(true); changed(); });
  find("alone").addEventListener("click", () => { state.shown = players.map((_, p) => p === state.solid); changed(); });
  find("together").addEventListener("click", () => { state.together = !state.together; changed(); });
  find("trail").addEventListener("change", (e) => { state.trail = e.target.value; moved(); });
  find("linear").addEventListener("click", (e) => {
    strips.linear = !strips.linear;
    e.target.ariaPressed = strips.linear;
    redraw();
  });
  find("zoom").addEventListener("change", (e) => {
    strips.stretch(Number(e.target.value), state.t);
    redraw();
  });
  for (const b of root.querySelectorAll("[data-view]")) b.addEventListener("click", () => { view.show(b.dataset.view); moved(); });

  document.addEventListener("keydown", (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey || e.target.closest("select, input:not([type=range]), textarea")) return;
    const at = motions[state.solid], stored = (by) => { at.at(state.t); seek(at.t[Math.min(Math.max(at.k + by, 0), at.n - 1)]); };
    const does = {
      ArrowRight: () => seek(state.t + play.t_end * (e.shiftKey ? 0.02 : 0.002)), ArrowLeft: () => seek(state.t - play.t_end * (e.shiftKey ? 0.02 : 0.002)),
      Home: () => seek(0), End: () => seek(play.t_end), ".": () => stored(1), ",": () => stored(-1),
      n: () => next("*"), p: () => next("*", -1), "+": () => faster(1), "-": () => faster(-1),
    }[e.key];
    if (e.key === " " && !e.target.closest("button, a, summary")) { e.preventDefault(); toggle(); }
    else if (does) {
      e.preventDefault();
      if (e.key.length > 1 || "np.,".includes(e.key)) pause();
      does();
    }
  });

  // size and theme
  function fit() {
    const ratio = Math.min(devicePixelRatio || 1, 2), room = canvas.parentElement, on = state.shown.filter(Boolean).length;
    const narrow = root.clientWidth < NARROW && !state.together; // a phone: as tall as its cells need
    const stageBox = room.closest(".stage");
    stageBox.classList.toggle("tall", narrow);
    stageBox.style.setProperty("--rows", Math.ceil(on / 2));
    const box = room.getBoundingClientRect();
    stage.resize(box.width, box.height, ratio);
    divide();
    const own = find("strips").parentElement.getBoundingClientRect();
    strips.resize(own.width, own.height, Math.max(ratio, 1));
    strips.seek(state.t);
    redraw();
  }
  const theme = () => {
    const colours = Object.fromEntries(["ink", "muted", "rule", "card"].map((c) => [c, MBS.colour(`--${c}`)]));
    stage.theme(colours);
    strips.theme(colours);
  };
  MBS.onTheme(() => { theme(); redraw(); });
  theme();
  view.show(asked.get("view") in { front: 1, side: 1, above: 1, oblique: 1 } ? asked.get("view") : "start");
  changed();
  new ResizeObserver(fit).observe(root);
  document.querySelector("[data-renderer]").textContent = stage.facts().renderer;
  addEventListener("hashchange", () => {
    const t = Number(new URLSearchParams(location.hash.slice(1)).get("t"));
    if (t > 0) { pause(); seek(t); }
  });
  if (asked.has("t")) seek(Number(asked.get("t")) || 0);
  else if (!still.matches) start();
  root.dataset.ready = flat ? "flat" : "solid";
})();
