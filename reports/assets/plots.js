// Interactive plots from the plain data of reports/plots/browser.py: one legend for the page, linked zoom, files for papers.
(async () => {
  const MBS = window.MBS;
  const DASHES = ["solid", "8px,3px", "2px,3px", "8px,3px,2px,3px"];
  const SYMBOLS = { o: "circle", P: "cross", s: "square", "^": "triangle-up", v: "triangle-down", D: "diamond", h: "hexagon", p: "pentagon", "<": "triangle-left" };
  const ENDS = { failed: "star", wrong: "x" };
  const END_WORDS = { failed: "★ stopped here", wrong: "✗ wrong: false success" };
  const LIGHT = { ink: "#1c2126", muted: "#57606a", rule: "#dfe3e8", card: "#ffffff" };
  const coarse = matchMedia("(pointer: coarse)").matches;
  const shown = { hidden: new Set(), group: "*", all: false };
  const plots = [];

  const theme = () => Object.fromEntries(Object.keys(LIGHT).map((k) => [k, MBS.colour(`--${k}`)]));
  const escaped = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const list = (a) => (a && a.kind ? MBS.numbers(a) : a || []);
  const axisTitle = (axis) => (axis.unit ? `${axis.title} [${axis.unit}]` : axis.title);
  const number = MBS.number;
  const tint = (hex, alpha) => `rgba(${[1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16)).join(", ")}, ${alpha})`;

  // a trace with its arrays unpacked; once
  const unpack = (t) => ({ mode: "lines", ...t, x: list(t.x), y: list(t.y), low: t.low && list(t.low), high: t.high && list(t.high),
    left: t.left && list(t.left), right: t.right && list(t.right), end: t.end || "",
    ends: said(t, "ends"), urls: said(t, "urls"), words: said(t, "words") });
  const said = (t, key) => t[key] && list(t[key]).map((k) => (typeof k === "number" ? t.texts[k] : k));
  const visible = (t) => !(t.solver && shown.hidden.has(t.solver))
    && (shown.group === "*" || t.group === undefined || t.group === shown.group) && (shown.all || t.main !== false);

  // without a solver there is nothing that a limit or a reference would be compared with
  const seen = (plot) => { const own = plot.traces.filter(visible); return own.some((t) => t.solver) || !plot.traces.some((t) => t.solver) ? own : []; };

  // zeros have no place on a logarithmic axis: points get one below the smallest value, lines a gap
  const floorOf = (traces, key) => {
    const points = traces.filter((t) => t.mode !== "lines");
    const positive = (points.length ? points : traces).flatMap((t) => t[key]).filter((v) => v > 0);
    return positive.length ? positive.reduce((a, b) => Math.min(a, b)) / 20 : 1e-16;
  };
  const placed = (values, axis, floor, points) => (axis.log
    ? values.map((v) => (v > 0 ? v : v === 0 && points ? floor : null)) : values);

  const drawn = (plot, colours) => {
    const own = seen(plot);
    const [fx, fy] = [floorOf(own, "x"), floorOf(own, "y")];
    const out = [];
    for (const t of own) {
      const points = t.mode !== "lines", colour = t.colour || colours.ink;
      const x = placed(t.x, plot.x, fx, points), y = placed(t.y, plot.y, fy, points);
      const base = { type: "scatter", x, showlegend: false, name: escaped(t.name), meta: t, line: { color: colour } };
      if (t.low) {
        const edge = { ...base, mode: "lines", line: { width: 0 }, hoverinfo: "skip" };
        out.push({ ...edge, y: placed(t.low, plot.y, fy, true) });
        out.push({ ...edge, y: placed(t.high, plot.y, fy, true), fill: "tonexty", fillcolor: t.colour ? tint(t.colour, 0.16) : "rgba(128,128,128,.16)" });
      }
      const ends = x.map((_, k) => (t.ends && t.ends[k]) || (t.end && k === x.length - 1 ? t.end : ""));
      const at = ends.flatMap((e, k) => (e ? [k] : []));
      const shownValue = (axis, value, at) => `${axis.title} ${value === 0 && axis.log && points ? `0, drawn at ${number(at)}` : number(value)} ${axis.unit || ""}`;
      const most = points ? x.map((_, k) => Boolean((plot.x.log && t.x[k] === 0) || (plot.y.log && t.y[k] === 0))) : [];
      const open = (f) => (most.includes(true) ? most.map((m) => f(t.hollow || m)) : f(t.hollow)); // at most: hollow
      const text = x.map((_, k) => escaped(
        [shownValue(plot.x, t.x[k], x[k]), shownValue(plot.y, t.y[k], y[k]),
          t.words && t.words[k], ends[k] && END_WORDS[ends[k]]].filter(Boolean).join("\n")).replace(/\n/g, "<br>"));
      const hover = { text, hovertemplate: "<b>%{fullData.name}</b><br>%{text}<extra></extra>" };
      out.push({ ...base, ...hover, y, mode: t.mode, connectgaps: !points,
        ...(t.left ? { error_x: { type: "data", symmetric: false, array: t.right.map((v, k) => v - (x[k] ?? v)), arrayminus: t.left.map((v, k) => (x[k] ?? v) - v),
          color: tint(t.colour, 0.45), thickness: 4, width: 0 } } : {}),
        line: { color: colour, width: t.solver ? 1.7 : 1.1, dash: DASHES[(t.dash || 0) % DASHES.length] },
        marker: { color: colour, size: t.hollow ? 11 : 8, symbol: open((o) => (SYMBOLS[t.marker] || "circle") + (o ? "-open" : "")),
          line: { color: open((o) => (o ? colour : colours.card)), width: open((o) => (o ? 1.8 : 0.8)) },
          opacity: x.map((_, k) => (points && ends[k] ? 0 : 1)) } });
      if (at.length) {
        out.push({ ...base, x: at.map((k) => x[k]), y: at.map((k) => y[k]), mode: "markers", cliponaxis: false,
          text: at.map((k) => text[k]), hovertemplate: hover.hovertemplate, customdata: at,
          marker: { color: colour, size: 13, symbol: at.map((k) => (ENDS[ends[k]] || "star") + (most[k] ? "-open" : "")), line: { color: colours.ink, width: 1.2 } } });
      }
    }
    return out;
  };

  const layoutOf = (plot, colours) => {
    const axis = (a, name) => {
      const log = Boolean(a.log), limits = [a.low, a.high];
      const ends = name === "y" ? seen(plot).flatMap((t) => t.reach || []) : []; // of what is shown, not of what is hidden
      const low = Math.min(...ends), high = Math.max(...ends), room = 0.08 * (high - low || Math.abs(high) || 1);
      if (ends.length && Number.isFinite(a.low)) [limits[0], limits[1]] = log ? [Math.max(a.low, low / 2), Math.min(a.high, 3 * high)] : [Math.max(a.low, low - room), Math.min(a.high, high + room)];
      const given = limits.every((v) => v !== undefined && v !== null && (!log || v > 0));
      return { type: log ? "log" : "linear", title: { text: escaped(axisTitle(a)), standoff: 8, font: { size: 12 } }, automargin: true,
        gridcolor: colours.rule, linecolor: colours.muted, tickcolor: colours.muted, showline: true, zeroline: false, ticks: "outside",
        ticklen: 4, exponentformat: name === "x" && log && !a.unit ? "SI" : "power", tickfont: { size: 11, color: colours.muted }, nticks: name === "x" ? 7 : 6,
        uirevision: `${log}`, ...(given ? { range: log ? limits.map(Math.log10) : limits } : { autorange: true }) };
    };
    const lines = Object.values(plot.marks || {}).flat().map((at) => ({ type: "line", x0: at, x1: at, y0: 0, y1: 1, yref: "paper",
      line: { color: colours.muted, width: 1, dash: "dot" }, layer: "below" }));
    // what belongs to no solver has its name at its end, a limit (two points) at its start, where errors are small
    const place = (v, a) => (a.log ? Math.log10(v) : v);
    const named = seen(plot).flatMap((t) => { const limit = t.x.length === 2, k = limit ? 0 : t.x.length - 1; return t.solver || t.mode !== "lines" || k < 0 || !(t.y[k] > 0 || !plot.y.log) ? [] : [{ text: escaped(t.name),
      x: place(t.x[k], plot.x), y: place(t.y[k], plot.y), showarrow: false, xanchor: limit ? "left" : "right", yanchor: "bottom", font: { size: 11, color: colours.muted } }]; });
    const empty = seen(plot).length ? [] : [{ text: "nothing is selected", showarrow: false, xref: "paper", yref: "paper", x: 0.5, y: 0.5 }];
    return { xaxis: axis(plot.x, "x"), yaxis: axis(plot.y, "y"), margin: { l: 56, r: 14, t: 10, b: 44 }, paper_bgcolor: colours.card,
      plot_bgcolor: colours.card, font: { family: getComputedStyle(document.body).fontFamily, color: colours.ink, size: 12 }, hovermode: "closest",
      hoverlabel: { bgcolor: colours.card, bordercolor: colours.muted, font: { color: colours.ink, size: 12 }, align: "left", namelength: -1 },
      dragmode: coarse ? false : "zoom", shapes: lines, annotations: [...named, ...empty], uirevision: "kept", showlegend: false };
  };

  const render = (plot) => {
    if (!plot.ready) return;
    const colours = theme();
    Plotly.react(plot.canvas, drawn(plot, colours), layoutOf(plot, colours), { displayModeBar: false, responsive: true });
    if (plot.table.open) fill(plot);
  };

  // axes with the same link show the same stretch
  let following = false;
  const follow = (plot, change) => {
    if (following || !plot.x.link || !Object.keys(change).some((k) => k.startsWith("xaxis"))) return;
    const { range, autorange } = plot.canvas.layout.xaxis;
    following = true;
    const others = plots.filter((p) => p !== plot && p.ready && p.x.link === plot.x.link && Boolean(p.x.log) === Boolean(plot.x.log));
    const to = autorange ? { "xaxis.autorange": true } : { "xaxis.range": [...range] };
    Promise.all(others.map((p) => Plotly.relayout(p.canvas, to))).finally(() => { following = false; });
  };
  const reset = (plot) => {
    const colours = theme(), layout = layoutOf(plot, colours);
    const to = ["xaxis", "yaxis"].map((name) => (layout[name].range ? [`${name}.range`, layout[name].range] : [`${name}.autorange`, true]));
    Plotly.relayout(plot.canvas, Object.fromEntries(to));
  };

  const save = (name, kind, text) => {
    const link = MBS.element("a", { href: URL.createObjectURL(new Blob([text], { type: kind })), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  };
  const csv = (plot) => {
    const quote = (v) => (/[",\n]/.test(v) ? `"${String(v).replace(/"/g, '""')}"` : v);
    const band = plot.traces.some((t) => t.low);
    const rows = [["series", axisTitle(plot.x), axisTitle(plot.y), ...(band ? ["lowest", "highest"] : []), "end"].map(quote)];
    for (const t of plot.traces.filter(visible)) {
      t.x.forEach((x, k) => rows.push([quote(t.name), x, t.y[k], ...(band ? [t.low ? t.low[k] : "", t.high ? t.high[k] : ""] : []),
        (t.ends && t.ends[k]) || (k === t.x.length - 1 ? t.end : "")]));
    }
    return rows.map((r) => r.map((v) => v ?? "").join(",")).join("\n") + "\n";
  };
  // for papers: the light theme, whatever the page wears, with a legend, as the range is now
  const svg = async (plot) => {
    const layout = layoutOf(plot, LIGHT), full = plot.canvas._fullLayout;
    for (const name of ["xaxis", "yaxis"]) layout[name] = { ...layout[name], autorange: false, range: [...full[name].range] };
    const data = drawn(plot, LIGHT).map((t) => ({ ...t, showlegend: t.hoverinfo !== "skip" && !t.customdata }));
    Object.assign(layout, { showlegend: true, legend: { orientation: "h", y: -0.25, font: { size: 10 } }, title: { text: escaped(plot.title), font: { size: 13 } } });
    layout.margin = { ...layout.margin, t: 40 };
    const url = await Plotly.toImage({ data, layout }, { format: "svg", width: 720, height: 460 });
    return decodeURIComponent(url.slice(url.indexOf(",") + 1));
  };

  const row = (cells, kind = "td") => MBS.element("tr", {}, ...cells.map((textContent, k) => MBS.element(k === 0 ? "th" : kind,
    { textContent, scope: kind === "th" ? "col" : k === 0 ? "row" : "", className: k > 0 ? "n" : "" })));
  const fill = (plot) => {
    const own = plot.traces.filter(visible), points = own.some((t) => t.mode !== "lines");
    const table = document.createElement("table"), [x, y] = [axisTitle(plot.x), axisTitle(plot.y)];
    table.createCaption().textContent = `${plot.title}, as selected`;
    table.caption.className = "hidden";
    table.createTHead().append(row(points ? ["Series", x, y, "End"] : ["Series", `Smallest ${y}`, `Largest ${y}`, `at ${x}`, `Last ${y}`, `at ${x}`], "th"));
    const body = table.createTBody();
    for (const t of own) {
      if (points) t.x.forEach((v, k) => body.append(row([t.name, v === 0 && plot.x.title === "CPU time" ? "below the clock" : number(v), number(t.y[k]), (t.ends && END_WORDS[t.ends[k]]) || ""])));
      else if (t.y.length) {
        const extreme = (before) => t.y.reduce((best, v, k) => (before(v, t.y[best]) ? k : best), 0), last = t.y.length - 1;
        const low = extreme((a, b) => a < b), high = extreme((a, b) => a > b);
        body.append(row([t.name, number(t.y[low]), number(t.y[high]), number(t.x[high]), number(t.y[last]), `${number(t.x[last])} ${END_WORDS[t.end] || ""}`]));
      }
    }
    plot.table.querySelector("div").replaceChildren(MBS.element("div", { className: "scroll", tabIndex: 0 }, table));
  };

  const button = (textContent, ariaLabel, act) => {
    const b = MBS.element("button", { type: "button", textContent, ariaLabel });
    b.addEventListener("click", act);
    return b;
  };
  const toggle = (plot, which) => {
    const b = button(`log ${which}`, `Logarithmic ${which} axis of ${plot.title}`, () => {
      plot[which] = { ...plot[which], log: !plot[which].log };
      b.setAttribute("aria-pressed", Boolean(plot[which].log));
      render(plot);
      reset(plot);
    });
    b.setAttribute("aria-pressed", Boolean(plot[which].log));
    return b;
  };
  const keys = (plot) => (event) => {
    const by = { ArrowLeft: [-0.15, -0.15], ArrowRight: [0.15, 0.15], "+": [0.2, -0.2], "-": [-0.3, 0.3] }[event.key];
    if (event.key === "0") reset(plot);
    if (!by) return;
    event.preventDefault();
    const [a, b] = plot.canvas._fullLayout.xaxis.range, wide = b - a;
    Plotly.relayout(plot.canvas, { "xaxis.range": [a + by[0] * wide, b + by[1] * wide] });
  };

  const begin = (plot) => {
    if (plot.ready) return;
    plot.ready = true;
    plot.traces = plot.traces.map(unpack);
    const last = Math.max(...plot.traces.filter((t) => t.solver && t.x.length).map((t) => t.x[t.x.length - 1]));
    if (plot.canvas.dataset.only && plot.x.link && last > 0) plot.x = { ...plot.x, low: 0, high: 1.04 * last };
    render(plot);
    plot.canvas.on("plotly_relayout", (change) => follow(plot, change));
    plot.canvas.on("plotly_click", ({ points: [p] }) => {
      const urls = p.data.meta.urls, k = p.data.customdata ? p.data.customdata[p.pointIndex] : p.pointIndex;
      if (urls) location.href = urls.length === 1 ? urls[0] : urls[k];
    });
  };

  const legend = (bar) => {
    const solvers = new Map();
    plots.forEach((p) => p.traces.forEach((t) => { if (t.solver) solvers.set(t.solver, t); }));
    const box = bar.querySelector(".legend");
    const ENGINE = "<", engine = (t) => t.marker === ENGINE; // after the others, under a word of their own
    const ordered = [...solvers].sort(([a, s], [b, t]) => engine(s) - engine(t) || (a < b ? -1 : 1));
    for (const [name, trace] of ordered) {
      if (engine(trace) && !box.querySelector("span")) box.append(MBS.element("span", {}, "◁ engines"));
      const b = button(name, `Show ${name}`, () => {
        shown.hidden.has(name) ? shown.hidden.delete(name) : shown.hidden.add(name);
        b.setAttribute("aria-pressed", !shown.hidden.has(name));
        plots.forEach(render);
      });
      Object.assign(b, { className: "solver", style: `--c: ${trace.colour}`, ariaPressed: true, title: "Click: show or hide. Double click: this one alone." });
      b.addEventListener("dblclick", () => {
        const alone = shown.hidden.size === solvers.size - 1 && !shown.hidden.has(name);
        shown.hidden = new Set(alone ? [] : [...solvers.keys()].filter((s) => s !== name));
        for (const other of box.querySelectorAll("button")) other.setAttribute("aria-pressed", !shown.hidden.has(other.textContent));
        plots.forEach(render);
      });
      box.append(b);
    }
    const all = bar.querySelector("[data-switch=all]"), group = bar.querySelector("[data-switch=group]");
    all.closest("label").hidden = !plots.some((p) => p.traces.some((t) => t.main === false));
    all.addEventListener("change", () => { shown.all = all.checked; plots.forEach(render); });
    if (group) {
      shown.group = group.value;
      group.addEventListener("change", () => { shown.group = group.value; plots.forEach(render); });
    }
  };

  // a run's page shows its own curves out of its problem's plots: those where it moves off zero
  const bundles = {};
  for (const e of document.querySelectorAll("[data-plot], [data-plots-of]")) {
    const from = e.dataset.from || e.dataset.plotsOf;
    if (bundles[from]) continue;
    const { texts, plots: own } = await MBS.unpack(MBS[from]);
    for (const p of Object.values(own)) for (const t of p.traces) t.texts = texts;
    bundles[from] = own;
  }
  for (const box of document.querySelectorAll("[data-plots-of]")) {
    const { plotsOf: from, only } = box.dataset;
    for (const [name, p] of Object.entries(bundles[from])) {
      const own = p.traces.find((t) => t.urls && t.urls.n === 1 && said(t, "urls")[0] === only);
      if (!p.x.link || !own || !list(own.y).some((v) => v !== 0)) continue;
      const canvas = MBS.element("div", { className: "canvas" }), title = MBS.element("b", { textContent: p.title });
      Object.assign(canvas.dataset, { plot: name, from, only });
      box.append(MBS.element("figure", { className: "panel" }, MBS.element("figcaption", {}, title), canvas));
    }
  }
  for (const canvas of document.querySelectorAll("[data-plot]")) {
    const own = bundles[canvas.dataset.from][canvas.dataset.plot];
    const plot = { ...own, traces: own.traces.map((t) => ({ ...t })), name: canvas.dataset.plot, canvas, ready: false };
    const only = canvas.dataset.only;
    if (only) {
      plot.traces = plot.traces.filter((t) => !t.solver || (t.urls && said(t, "urls").includes(only)));
      plot.traces.forEach((t) => { delete t.urls; });
      shown.all = true;
      plot.x = { ...plot.x, high: undefined };
      plot.y = { ...plot.y, low: undefined, high: undefined };
    }
    const figure = canvas.closest("figure");
    Object.assign(canvas, { role: "group", ariaRoleDescription: "plot", tabIndex: 0, title: "",
      ariaLabel: `${plot.title}: ${plot.y.title} over ${plot.x.title}. Arrow keys move, plus and minus zoom, 0 shows all; the numbers are in the table below.` });
    canvas.insertAdjacentHTML("afterend", '<div class="tools"></div><details class="numbers"><summary>The numbers</summary><div></div></details>');
    plot.table = figure.querySelector("details.numbers");
    plot.table.addEventListener("toggle", () => { if (plot.table.open) { begin(plot); fill(plot); } });
    const tools = figure.querySelector(".tools");
    if (!plot.x.link) tools.append(toggle(plot, "x"));
    tools.append(toggle(plot, "y"), button("reset", `Show all of ${plot.title}`, () => reset(plot)),
      button("SVG", `Save ${plot.title} as SVG`, async () => save(`${plot.name}.svg`, "image/svg+xml", await svg(plot))),
      button("CSV", `Save the numbers of ${plot.title} as CSV`, () => save(`${plot.name}.csv`, "text/csv", csv(plot))));
    canvas.addEventListener("keydown", keys(plot));
    plots.push(plot);
  }
  document.querySelectorAll("[data-plots-bar]").forEach(legend);
  MBS.onTheme(() => plots.forEach(render));
  MBS.plotted = { plots, csv: (name) => csv(plots.find((p) => p.name === name)), svg: (name) => svg(plots.find((p) => p.name === name)) };
  const near = new IntersectionObserver((seen) => {
    for (const e of seen) if (e.isIntersecting) { near.unobserve(e.target); begin(plots.find((p) => p.canvas === e.target)); }
  }, { rootMargin: "300px" });
  plots.forEach((p) => near.observe(p.canvas));
})();
