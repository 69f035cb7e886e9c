// Plots from the plain data of reports/plots/browser.py as SVG: a few solvers in colour, the others grey until one asks for them.
(async () => {
  const MBS = window.MBS;
  const DASHES = ["", "8 3", "2 3", "8 3 2 3"];
  const END_WORDS = { failed: "★ stopped here", wrong: "✗ wrong: false success" };
  const SHAPES = { // around 0, 0 in a box of 8
    o: "M4 0a4 4 0 1 1-8 0a4 4 0 1 1 8 0z", s: "M-3.4-3.4h6.8v6.8h-6.8z", "^": "M0-4.4l4.2 7.4h-8.4z", v: "M0 4.4l4.2-7.4h-8.4z", D: "M0-4.6l4.6 4.6l-4.6 4.6l-4.6-4.6z",
    P: "M-1.5-4.2h3v2.7h2.7v3h-2.7v2.7h-3v-2.7h-2.7v-3h2.7z", h: "M0-4.5l3.9 2.2v4.6l-3.9 2.2l-3.9-2.2v-4.6z", p: "M0-4.4l4.2 3l-1.6 5h-5.2l-1.6-5z", "<": "M-4.4 0l7.4-4.2v8.4z",
    failed: "M0-8l2 5.4l5.8.2l-4.6 3.5l1.6 5.5l-4.8-3.2l-4.8 3.2l1.6-5.5l-4.6-3.5l5.8-.2z", wrong: "M-6-4l2-2l4 4l4-4l2 2l-4 4l4 4l-2 2l-4-4l-4 4l-2-2l4-4z" };
  const MOST = 7, NEAR = 24, LETTER = 6.4; // solvers in colour, pixels of the pointer, width of a letter
  const coarse = matchMedia("(pointer: coarse)").matches;
  const asked = new URLSearchParams(location.search).get("solver");
  const shown = { pinned: new Set(asked ? asked.split(",") : []), over: "", group: "*", all: false };
  const plots = [];

  const escaped = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;").replace(/"/g, "&quot;");
  const list = (a) => (a && a.kind ? MBS.numbers(a) : a || []);
  const axisTitle = (axis) => (axis.unit ? `${axis.title} [${axis.unit}]` : axis.title);
  const number = MBS.number, tick = (v) => number(v, v === 0 ? 1 : 2).replace(/^1\.0×/, "").replace(/(\.\d*?)0+(?=×|$)/, "$1").replace(/\.(?=×|$)/, "");

  const said = (t, key) => t[key] && list(t[key]).map((k) => (typeof k === "number" ? t.texts[k] : k));
  // a trace with its arrays unpacked; once
  const unpack = (t) => ({ mode: "lines", ...t, x: list(t.x), y: list(t.y), low: t.low && list(t.low), high: t.high && list(t.high),
    left: t.left && list(t.left), right: t.right && list(t.right), end: t.end || "", ends: said(t, "ends"), urls: said(t, "urls"), words: said(t, "words") });
  const visible = (t) => (shown.group === "*" || t.group === undefined || t.group === shown.group) && (shown.all || t.main !== false);
  const seen = (plot) => { const own = plot.traces.filter(visible); return own.some((t) => t.solver) || !plot.traces.some((t) => t.solver) ? own : []; };
  const endOf = (t, k) => (t.ends && t.ends[k]) || (t.end && k === t.x.length - 1 ? t.end : "");

  // solvers in colour: those asked for, else the plot's own choice
  const focus = (plot) => {
    const own = [...new Set(seen(plot).map((t) => t.solver).filter(Boolean))], has = (names) => names.filter((n) => own.includes(n));
    const picked = has([...shown.pinned, ...(shown.over ? [shown.over] : [])]);
    if (picked.length) return new Set(picked);
    const first = has(plot.canvas.dataset.focus ? [plot.canvas.dataset.focus] : plot.focus || []);
    return new Set(first.length ? first : own.slice(0, MOST));
  };

  // zeros have no place on a logarithmic axis: points get one below the smallest value, lines a gap
  const floorOf = (traces, key) => {
    const points = traces.filter((t) => t.mode !== "lines");
    const positive = (points.length ? points : traces).flatMap((t) => t[key]).filter((v) => v > 0);
    return positive.length ? positive.reduce((a, b) => Math.min(a, b)) / 20 : 1e-16;
  };
  const limits = (plot, which, own, floor) => {
    const axis = plot[which], log = Boolean(axis.log);
    if (axis.names) return [-0.5, axis.names.length - 0.5];
    let [low, high] = [axis.low, axis.high];
    const ends = which === "y" ? own.flatMap((t) => t.reach || []) : []; // of what is shown, not of what is hidden
    if (ends.length && Number.isFinite(low)) {
      const [a, b] = [Math.min(...ends), Math.max(...ends)], room = 0.08 * (b - a || Math.abs(b) || 1);
      [low, high] = log ? [Math.max(low, a / 2), Math.min(high, 3 * b)] : [Math.max(low, a - room), Math.min(high, b + room)];
    }
    const good = (v) => Number.isFinite(v) && (!log || v > 0);
    if (!good(low) || !good(high)) {
      const keys = which === "y" ? ["y", "low", "high"] : ["x", "left", "right"];
      const all = [...own, ...(plot.x.log && plot.y.log ? plot.triangles || [] : [])].flatMap((t) => keys.flatMap((k) => t[k] || [])).map((v) => (log && v === 0 ? floor : v)).filter(good);
      const [a, b] = all.length ? all.reduce(([p, q], v) => [Math.min(p, v), Math.max(q, v)], [Infinity, -Infinity]) : [log ? 1e-3 : 0, 1];
      const room = log ? Math.max((b / a) ** 0.06, 1.3) : 0.06 * (b - a || Math.abs(b) || 1);
      if (!good(low)) low = log ? a / room : a - room;
      if (!good(high)) high = log ? b * room : b + room;
    }
    return [low, high];
  };
  const ticksOf = (log, [low, high], most) => {
    if (log) {
      const [a, b] = [Math.ceil(Math.log10(low) - 1e-9), Math.floor(Math.log10(high) + 1e-9)], out = [];
      if (b - a >= 1) { const step = Math.ceil((b - a + 1) / most); for (let d = a; d <= b; d += step) out.push(10 ** d); return out; }
      for (let d = a - 1; d <= b + 1; d++) for (const m of [1, 2, 5]) { const v = m * 10 ** d; if (v >= low && v <= high) out.push(v); }
      return out;
    }
    const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough)), step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough);
    return Array.from({ length: 1 + Math.floor(high / step + 1e-9) - Math.ceil(low / step - 1e-9) }, (_, k) => (Math.ceil(low / step - 1e-9) + k) * step);
  };

  const ticksAt = (axis, range, most) => (axis.names ? axis.names.map((_, k) => k).filter((k) => k >= range[0] && k <= range[1]) : ticksOf(axis.log, range, most));
  const tickWords = (axis, v) => (axis.names ? axis.names[v] : tick(v));

  // the picture of a plot `w` by `h` pixels; `places` remembers where its points are
  const drawing = (plot, w, h, paper = false) => {
    const own = seen(plot), lit = paper ? new Set(own.map((t) => t.solver)) : focus(plot), floor = { x: floorOf(own, "x"), y: floorOf(own, "y") };
    const whole = { x: limits(plot, "x", own, floor.x), y: limits(plot, "y", own, floor.y) }, range = { ...whole, ...plot.zoom };
    const yTicks = ticksAt(plot.y, range.y, 6), left = 16 + Math.max(22, ...yTicks.map((v) => LETTER * tickWords(plot.y, v).length + 6)), top = paper ? 30 : 8, right = w - 12, bottom = h - 38;
    const map = (which, a, b) => { const log = plot[which].log, f = log ? Math.log10 : (v) => v, [lo, hi] = range[which].map(f); return (v) => a + ((f(v) - lo) / (hi - lo || 1)) * (b - a); };
    const [X, Y] = [map("x", left, right), map("y", bottom, top)], parts = [], over = [], labels = [], places = [];
    const at = (which, v, points) => (plot[which].log && !(v > 0) ? (v === 0 && points ? Math.max(floor[which], range[which][0]) : NaN) : v);
    const text = (x, y, words, more = "") => `<text x="${x.toFixed(1)}" y="${y.toFixed(1)}" ${more}>${escaped(words)}</text>`;
    const xTicks = ticksAt(plot.x, range.x, Math.max(2, Math.floor((right - left) / 70)));
    for (const v of yTicks) parts.push(`<path class="grid" d="M${left} ${Y(v).toFixed(1)}H${right}"/>`, text(left - 6, Y(v) + 4, tickWords(plot.y, v), 'text-anchor="end"'));
    for (const v of xTicks) parts.push(`<path class="grid" d="M${X(v).toFixed(1)} ${top}V${bottom}"/>`, text(X(v), bottom + 15, tickWords(plot.x, v), 'text-anchor="middle"'));
    parts.push(`<path class="axis" d="M${left} ${top}V${bottom}H${right}"/>`, text((left + right) / 2, h - 6, axisTitle(plot.x), 'text-anchor="middle" class="name"'),
      `<text transform="translate(12 ${(top + bottom) / 2}) rotate(-90)" text-anchor="middle" class="name">${escaped(axisTitle(plot.y))}</text>`);
    for (const [words, values] of Object.entries(plot.marks || {})) for (const v of values) parts.push(`<path class="mark-line" d="M${X(v).toFixed(1)} ${top}V${bottom}"/>`, text(X(v) - 4, bottom - 6, words, 'text-anchor="end" class="halo"'));
    for (const { order, x: [x0, x1], y: [y0, y1] } of plot.x.log && plot.y.log ? plot.triangles || [] : []) { // a slope has its meaning on two logarithmic axes alone
      const inside = [x0, x1].every((v) => v >= range.x[0] && v <= range.x[1]) && [y0, y1].every((v) => v >= range.y[0] && v <= range.y[1]);
      if (!inside) continue;
      parts.push(`<path class="slope" d="M${X(x0).toFixed(1)} ${Y(y0).toFixed(1)}H${X(x1).toFixed(1)}V${Y(y1).toFixed(1)}z"/>`,
        text((X(x0) + X(x1)) / 2, Y(y0) + 12, "1", 'text-anchor="middle"'), text(X(x1) + 4, (Y(y0) + Y(y1)) / 2 + 4, order));
    }
    const clip = `clip-${plot.name.replace(/[^\w-]/g, "-")}`;
    const order = [...own].sort((a, b) => (!a.solver - !b.solver) * -1 || lit.has(a.solver) - lit.has(b.solver));
    for (const t of order) {
      const points = t.mode !== "lines", on = !t.solver || lit.has(t.solver), colour = !t.solver ? "var(--ink)" : on ? t.colour : "var(--ghost)";
      const xs = t.x.map((v) => X(at("x", v, points))), ys = t.y.map((v) => Y(at("y", v, points)));
      const path = (values) => values.reduce((d, y, k) => (Number.isFinite(y) && Number.isFinite(xs[k]) ? `${d}${d && (points || Number.isFinite(values[k - 1])) ? "L" : "M"}${xs[k].toFixed(1)} ${y.toFixed(1)}` : d), "");
      if (t.low && on) {
        const edge = (v) => v.map((u) => Y(Math.max(at("y", u, true), range.y[0])));
        const [hi, lo] = [edge(t.high), edge(t.low)], back = lo.map((y, k) => `L${xs[lo.length - 1 - k].toFixed(1)} ${lo[lo.length - 1 - k].toFixed(1)}`).join("");
        parts.push(`<path d="${path(hi)}${back}z" fill="${t.solver ? colour : "var(--muted)"}" opacity=".16" clip-path="url(#${clip})"/>`);
      }
      if (t.left && on) t.left.forEach((v, k) => parts.push(`<path d="M${X(Math.max(v, range.x[0])).toFixed(1)} ${ys[k].toFixed(1)}H${X(t.right[k]).toFixed(1)}" stroke="${colour}" stroke-width="4" opacity=".4"/>`));
      if (t.mode !== "markers") parts.push(`<path class="line" d="${path(ys)}" stroke="${colour}" stroke-width="${!t.solver ? 1.3 : on ? 2 : 1}" stroke-dasharray="${on ? DASHES[(t.dash || 0) % DASHES.length] : ""}" clip-path="url(#${clip})"${t.solver ? ` data-solver="${escaped(t.solver)}"` : ""}/>`);
      let last = -1;
      xs.forEach((x, k) => {
        const y = ys[k];
        if (!(x >= left - 1 && x <= right + 1 && y >= top - 1 && y <= bottom + 1)) return;
        last = k;
        const end = endOf(t, k);
        places.push([x, y, t, k]);
        if (!points && !end) return;
        const open = t.hollow || (plot.x.log && t.x[k] === 0) || (plot.y.log && t.y[k] === 0), size = end ? 0.85 : t.hollow ? 1.5 : on ? 1 : 0.75;
        (on ? over : parts).push(`<path d="${SHAPES[end] || SHAPES[t.marker] || SHAPES.o}" transform="translate(${x.toFixed(1)} ${y.toFixed(1)}) scale(${size})" fill="${open ? "none" : colour}" stroke="${open ? colour : end && on ? "var(--ink)" : "var(--card)"}" stroke-width="${open ? 1.6 : 0.8}" class="point${open ? " open" : ""}${end ? ` end-${end}` : ""}"${t.solver ? ` data-solver="${escaped(t.solver)}"` : ""}/>`);
      });
      if (last < 0) continue;
      const limit = !t.solver && t.x.length === 2, k = limit ? 0 : last;
      if (t.solver ? on && t.main !== false && !labels.some((l) => l.name === t.solver) : t.mode === "lines") labels.push({ name: t.solver || t.name, x: limit ? left + 4 : xs[k], y: ys[k], colour: t.solver ? colour : "var(--muted)", start: limit });
    }
    // names at the ends of lines, none over another
    const placed = [];
    for (const l of labels.sort((a, b) => a.y - b.y)) {
      const wide = 7 * l.name.length, inside = (x) => x >= left && x + wide <= right;
      const beside = (l.start ? [l.x, right - wide - 4] : [l.x + 8, l.x - wide - 8]).filter(inside), sides = beside.length ? beside : [Math.max(right - wide, left)];
      const home = Math.min(Math.max(l.y + (l.start ? -6 : 4), top + 10), bottom - 4);
      const free = ([x, y]) => y >= top + 9 && y <= bottom - 3 && !placed.some((p) => Math.abs(p.y - y) < 12 && x < p.x1 + 4 && x + wide + 4 > p.x0);
      const spots = Array.from({ length: 28 }, (_, i) => home + (i % 2 ? 1 : -1) * 3 * Math.ceil(i / 2)).flatMap((y) => sides.map((x) => [x, y]));
      const spot = spots.find(free);
      if (!spot) continue; // where a name has no room it would cover others; the pointer and the legend tell it
      const [x0, y] = spot;
      placed.push({ x0, x1: x0 + wide, y });
      over.push(text(x0, y, l.name, `class="label halo" style="fill: color-mix(in srgb, ${l.colour} 78%, var(--ink))"`));
    }
    if (!own.length) over.push(text((left + right) / 2, (top + bottom) / 2, "nothing is selected", 'text-anchor="middle"'));
    if (paper) over.push(text(left, 18, plot.title, 'class="name"'));
    plot.view = { X, Y, left, right, top, bottom, range, whole, places };
    return `<defs><clipPath id="${clip}"><rect x="${left}" y="${top}" width="${Math.max(right - left, 1)}" height="${Math.max(bottom - top, 1)}"/></clipPath></defs>${parts.join("")}${over.join("")}`;
  };

  const render = (plot) => {
    if (!plot.ready) return;
    const { clientWidth: w, clientHeight: h } = plot.canvas;
    if (!w || !h) return;
    plot.picture.setAttribute("viewBox", `0 0 ${w} ${h}`);
    plot.picture.innerHTML = drawing(plot, w, h);
    if (plot.table.open) fill(plot);
  };
  const renderAll = () => plots.forEach(render);

  // what is in colour is the same in all plots, and what else listens: heat maps, races
  const spread = () => { renderAll(); document.dispatchEvent(new CustomEvent("mbs-solver", { detail: { over: shown.over, pinned: [...shown.pinned] } })); };
  MBS.hover = (name) => { if (shown.over !== name) { shown.over = name; spread(); } };
  MBS.pin = (name) => {
    shown.pinned.has(name) ? shown.pinned.delete(name) : shown.pinned.add(name);
    for (const b of document.querySelectorAll(".legend button")) b.setAttribute("aria-pressed", shown.pinned.has(b.textContent));
    const kept = new URLSearchParams(location.search);
    shown.pinned.size ? kept.set("solver", [...shown.pinned].join(",")) : kept.delete("solver");
    try { history.replaceState(null, "", `${location.pathname}${kept.size ? "?" : ""}${kept}${location.hash}`); } catch { /* not kept */ }
    spread();
  };

  const zoom = (plot, range) => { // axes with the same link show the same stretch
    const to = plots.filter((p) => p === plot || (plot.x.link && p.x.link === plot.x.link && Boolean(p.x.log) === Boolean(plot.x.log)));
    to.forEach((p) => { p.zoom = range ? { x: range } : {}; render(p); });
  };
  const nearest = (plot, x, y) => {
    let best = null, least = NEAR ** 2;
    for (const p of plot.view.places) { const d = (p[0] - x) ** 2 + (p[1] - y) ** 2; if (d < least) [best, least] = [p, d]; }
    return best;
  };
  const words = (plot, t, k) => {
    const value = (axis, v, which) => axis.names ? axis.names[v] : `${axis.title} ${v === 0 && axis.log && t.mode !== "lines" ? `0, drawn at ${number(floorOf(seen(plot), which))}` : number(v)} ${axis.unit || ""}`;
    return [t.name, value(plot.x, t.x[k], "x"), value(plot.y, t.y[k], "y"), t.words && t.words[k], END_WORDS[endOf(t, k)]].filter(Boolean);
  };
  const tip = MBS.element("div", { className: "tip", hidden: true });
  document.body.append(tip);
  const tell = (event, lines) => {
    tip.hidden = !lines;
    if (!lines) return;
    tip.replaceChildren(MBS.element("b", {}, lines[0]), ...lines.slice(1).map((l) => MBS.element("div", {}, l)));
    const { width, height } = tip.getBoundingClientRect();
    Object.assign(tip.style, { left: `${Math.max(8, Math.min(event.clientX + 14, innerWidth - width - 8))}px`, top: `${event.clientY + 18 + height > innerHeight ? Math.max(event.clientY - height - 12, 4) : event.clientY + 18}px` });
  };
  MBS.tell = tell;
  const pointer = (plot) => {
    const canvas = plot.canvas, place = (e) => { const b = canvas.getBoundingClientRect(); return [e.clientX - b.left, e.clientY - b.top]; };
    const value = (x) => { const { left, right, range } = plot.view, s = (x - left) / (right - left), f = plot.x.log ? Math.log10 : (v) => v, [a, b] = range.x.map(f); return plot.x.log ? 10 ** (a + s * (b - a)) : a + s * (b - a); };
    let from = null;
    canvas.addEventListener("pointermove", (e) => {
      if (!plot.view) return;
      const [x, y] = place(e), hit = nearest(plot, x, y);
      tell(e, hit && words(plot, hit[2], hit[3]));
      canvas.style.cursor = hit && hit[2].urls ? "pointer" : "";
      if (from === null) MBS.hover(hit ? hit[2].solver || "" : "");
    });
    canvas.addEventListener("pointerleave", () => { tell(null, null); MBS.hover(""); });
    canvas.addEventListener("pointerdown", (e) => { if (!coarse && plot.view) from = place(e)[0]; });
    canvas.addEventListener("pointerup", (e) => {
      const [x, y] = place(e), start = from;
      from = null;
      if (start !== null && Math.abs(x - start) > 12) return zoom(plot, [start, x].sort((a, b) => a - b).map(value));
      const hit = plot.view && nearest(plot, x, y);
      if (!hit || !hit[2].urls) return;
      if (coarse && plot.told !== hit[2]) { plot.told = hit[2]; return tell(e, words(plot, hit[2], hit[3])); }
      location.href = hit[2].urls.length === 1 ? hit[2].urls[0] : hit[2].urls[hit[3]];
    });
    canvas.addEventListener("dblclick", () => zoom(plot, null));
    canvas.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-0.15, -0.15], ArrowRight: [0.15, 0.15], "+": [0.2, -0.2], "-": [-0.3, 0.3] }[event.key];
      if (event.key === "0") zoom(plot, null);
      if (!by || !plot.view) return;
      event.preventDefault();
      const { left, right } = plot.view;
      zoom(plot, [value(left + by[0] * (right - left)), value(right + by[1] * (right - left))]);
    });
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
    const put = (axis, v) => (axis.names ? quote(axis.names[v]) : v);
    for (const t of plot.traces.filter(visible)) t.x.forEach((x, k) => rows.push([quote(t.name), put(plot.x, x), put(plot.y, t.y[k]), ...(band ? [t.low ? t.low[k] : "", t.high ? t.high[k] : ""] : []), endOf(t, k)]));
    return rows.map((r) => r.map((v) => v ?? "").join(",")).join("\n") + "\n";
  };
  // for papers: the light theme, whatever the page wears, all lines in colour with their names
  const svg = (plot) => {
    const colours = { "--ink": "#1c2126", "--muted": "#57606a", "--rule": "#dfe3e8", "--card": "#ffffff", "--ghost": "#b6bcc3" };
    const style = "text{font:11px sans-serif;fill:#57606a}.name{fill:#1c2126;font-size:12px}.halo{paint-order:stroke;stroke:#fff;stroke-width:3px}.grid{stroke:#dfe3e8;fill:none}.axis{stroke:#57606a;fill:none}.line{fill:none}.mark-line{stroke:#57606a;stroke-dasharray:2 3}.slope{stroke:#57606a;fill:#dfe3e8;fill-opacity:.4}";
    const inside = drawing(plot, 720, 460, true).replace(/color-mix\(in srgb, (#\w+|var\(--\w+\)) 78%, var\(--ink\)\)/g, "$1").replace(/var\((--\w+)\)/g, (_, k) => colours[k]);
    render(plot);
    return `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 720 460" width="720" height="460"><style>${style}</style><rect width="720" height="460" fill="#fff"/>${inside}</svg>`;
  };

  const row = (cells, kind = "td") => MBS.element("tr", {}, ...cells.map((textContent, k) => k && kind === "td" ? MBS.element("td", { textContent, className: "n" })
    : MBS.element("th", { textContent, scope: kind === "th" ? "col" : "row", className: k ? "n" : "" })));
  const fill = (plot) => {
    const own = plot.traces.filter(visible), points = own.some((t) => t.mode !== "lines");
    const table = document.createElement("table"), [x, y] = [axisTitle(plot.x), axisTitle(plot.y)];
    table.createCaption().textContent = `${plot.title}, as selected`;
    table.caption.className = "hidden";
    table.createTHead().append(row(points ? ["Series", x, y, "End"] : ["Series", `Smallest ${y}`, `Largest ${y}`, `at ${x}`, `Last ${y}`, `at ${x}`], "th"));
    const body = table.createTBody(), told = (axis, v) => (axis.names ? axis.names[v] : number(v));
    for (const t of own) {
      if (points) t.x.forEach((v, k) => body.append(row([t.name, v === 0 && plot.x.title === "CPU time" ? "below the clock" : told(plot.x, v), told(plot.y, t.y[k]), END_WORDS[endOf(t, k)] || ""])));
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
    const b = button(`log ${which}`, `log ${which}: logarithmic ${which} axis of ${plot.title}`, () => {
      plot[which] = { ...plot[which], log: !plot[which].log };
      b.setAttribute("aria-pressed", Boolean(plot[which].log));
      render(plot);
    });
    b.setAttribute("aria-pressed", Boolean(plot[which].log));
    return b;
  };
  const begin = (plot) => {
    if (plot.ready) return;
    plot.ready = true;
    plot.traces = plot.traces.map(unpack);
    const last = Math.max(...plot.traces.filter((t) => t.solver && t.x.length).map((t) => t.x[t.x.length - 1]));
    if (plot.canvas.dataset.only && plot.x.link && last > 0) plot.x = { ...plot.x, low: 0, high: 1.04 * last };
    render(plot);
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
  const TOOLS = '<div class="tools"></div><details class="numbers"><summary>The numbers</summary><div></div></details>';
  for (const box of document.querySelectorAll("[data-plots-of]")) {
    const { plotsOf: from, only } = box.dataset;
    for (const [name, p] of Object.entries(bundles[from])) {
      const own = p.traces.find((t) => t.urls && t.urls.n === 1 && said(t, "urls")[0] === only);
      if (!p.x.link || !own || !list(own.y).some((v) => v !== 0)) continue;
      const canvas = MBS.element("div", { className: "canvas" }), title = MBS.element("b", { textContent: p.name || p.title });
      Object.assign(canvas.dataset, { plot: name, from, only });
      box.append(MBS.element("figure", { className: "panel" }, MBS.element("figcaption", {}, title), canvas));
      canvas.insertAdjacentHTML("afterend", TOOLS);
    }
  }
  for (const canvas of document.querySelectorAll("[data-plot]")) {
    const own = bundles[canvas.dataset.from][canvas.dataset.plot];
    const plot = { ...own, traces: own.traces.map((t) => ({ ...t })), name: canvas.dataset.plot, canvas, ready: false, zoom: {} };
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
    plot.picture = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    plot.picture.setAttribute("aria-hidden", "true");
    canvas.append(plot.picture);
    plot.table = figure.querySelector("details.numbers");
    plot.table.addEventListener("toggle", () => { if (plot.table.open) { begin(plot); fill(plot); } });
    const tools = figure.querySelector(".tools");
    for (const which of ["x", "y"]) if (!plot[which].link && !plot[which].names) tools.append(toggle(plot, which));
    tools.append(button("reset", `reset: show all of ${plot.title}`, () => zoom(plot, null)),
      button("SVG", `SVG: save ${plot.title}`, () => { begin(plot); save(`${plot.name}.svg`, "image/svg+xml", svg(plot)); }),
      button("CSV", `CSV: save the numbers of ${plot.title}`, () => { begin(plot); save(`${plot.name}.csv`, "text/csv", csv(plot)); }));
    pointer(plot);
    plots.push(plot);
  }
  for (const bar of document.querySelectorAll("[data-plots-bar]")) {
    for (const b of bar.querySelectorAll(".legend button")) {
      b.setAttribute("aria-pressed", shown.pinned.has(b.textContent));
      b.addEventListener("click", () => MBS.pin(b.textContent));
      b.addEventListener("pointerenter", () => MBS.hover(b.textContent));
      b.addEventListener("pointerleave", () => MBS.hover(""));
    }
    const all = bar.querySelector("[data-switch=all]"), group = bar.querySelector("[data-switch=group]");
    if (!all) continue;
    all.closest("label").style.visibility = plots.some((p) => p.traces.some((t) => t.main === false)) ? "" : "hidden";
    all.addEventListener("change", () => { shown.all = all.checked; renderAll(); });
    if (group) {
      shown.group = group.value;
      group.addEventListener("change", () => { shown.group = group.value; renderAll(); });
    }
  }
  const find = (name) => { const p = plots.find((q) => q.name === name); begin(p); return p; };
  MBS.plotted = { plots, shown, csv: (name) => csv(find(name)), svg: (name) => svg(find(name)), view: (name) => find(name).view, lit: (name) => [...focus(find(name))] };
  const sized = new ResizeObserver((all) => all.forEach((e) => render(plots.find((p) => p.canvas === e.target))));
  const near = new IntersectionObserver((found) => {
    for (const e of found) if (e.isIntersecting) { near.unobserve(e.target); begin(plots.find((p) => p.canvas === e.target)); sized.observe(e.target); }
  }, { rootMargin: "300px" });
  plots.forEach((p) => near.observe(p.canvas));
  addEventListener("beforeprint", () => plots.forEach(begin));
})();
