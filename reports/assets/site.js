// What every page has: the theme, sorting of tables, typed arrays from data files.
(() => {
  const MBS = (window.MBS ||= {});
  const kinds = { f4: Float32Array, u2: Uint16Array, i4: Int32Array };

  MBS.element = (tag, properties = {}, ...children) => {
    const e = Object.assign(document.createElement(tag), properties);
    e.append(...children);
    return e;
  };

  // a bundle of reports/plots/packing.py: a promise of its value, whose arrays are still {kind, at, n} and know their bytes
  MBS.unpack = async ({ packed }) => {
    const raw = Uint8Array.from(atob(packed), (c) => c.charCodeAt(0)), stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"));
    const whole = new Uint8Array(await new Response(stream).arrayBuffer());
    const head = new DataView(whole.buffer).getUint32(0, true), bytes = whole.subarray(4 + head);
    return JSON.parse(new TextDecoder().decode(whole.subarray(4, 4 + head)), (_, v) => (v && v.kind && v.at !== undefined ? { ...v, bytes } : v));
  };
  // the numbers of such an array, with as many digits as were stored
  MBS.numbers = ({ kind, at, n, bytes, low, log, step }) => {
    const width = kind === "u2" ? 2 : 4, rows = new Uint8Array(width * n);
    for (let k = 0; k < width; k++) for (let i = 0; i < n; i++) rows[i * width + k] = bytes[at + k * n + i];
    const values = Array.from(new kinds[kind](rows.buffer));
    if (kind === "f4") return values.map((v) => Number(v.toPrecision(7)));
    if (kind === "u2") for (let i = 1; i < n; i++) values[i] = (values[i] + values[i - 1]) & 0xffff;
    if (step === undefined) return values;
    return values.map((v) => Number((log === undefined ? low + v * step : v && Math.exp(log + (v - 1) * step)).toPrecision(log === undefined ? 6 : 5)));
  };

  // powers of ten as reports/model/words.py writes numbers
  MBS.raised = (n) => String(n).replace(/[-0-9]/g, (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);
  MBS.number = (v, digits = 3) => {
    if (v === null || v === undefined || Number.isNaN(v)) return "–";
    if (!Number.isFinite(v)) return v > 0 ? "∞" : "−∞";
    if (v === 0) return "0";
    const [mantissa, exponent] = Math.abs(v).toExponential(digits - 1).split("e"), power = Number(exponent), sign = v < 0 ? "−" : "";
    return sign + (power >= -3 && power < 5 ? Math.abs(v).toFixed(Math.max(digits - 1 - power, 0)) : `${mantissa}×10${MBS.raised(power)}`);
  };

  // pages in subfolders, of which there are thousands, have their navigation and what their numbers mean from one file each
  document.addEventListener("DOMContentLoaded", () => {
    const item = ([title, file]) => MBS.element("li", {}, MBS.element("a", { href: document.body.dataset.root + file }, title));
    for (const list of document.querySelectorAll("[data-nav]")) list.prepend(...(MBS.pages || []).map(item));
    for (const head of document.querySelectorAll("[data-meanings] dt")) {
      const meaning = (MBS.meanings || {})[head.textContent] || (head.textContent.startsWith("counted: ") ? "By the solver itself." : "");
      if (meaning) head.nextElementSibling.append(MBS.element("small", {}, meaning));
    }
  });

  // a page of results that are not all there looks whether its report has been written anew; from a disk scripts alone load
  const notice = document.querySelector("[data-written]");
  const look = () => {
    const script = MBS.element("script", { src: `${document.body.dataset.root}data/written.js?${Date.now()}` });
    script.onerror = () => { script.remove(); setTimeout(look, 5000); };  // it is being written
    script.onload = () => {
      script.remove();
      if (MBS.written === Number(notice.dataset.written)) return void setTimeout(look, 5000);
      const again = MBS.element("button", { type: "button", onclick: () => location.reload() }, "Reload");
      notice.replaceChildren(MBS.element("b", {}, `The report has been written anew, with ${MBS.written} runs. `), again);
    };
    document.head.append(script);
  };
  if (notice) setTimeout(look, 5000);

  // a link to what is folded, or what a filter hides, brings it back
  const reveal = () => {
    const target = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    for (let e = target; e; e = e.parentElement) { e.hidden = false; if (e.tagName === "DETAILS") e.open = true; }
    target.scrollIntoView();
  };
  addEventListener("hashchange", reveal);
  addEventListener("load", reveal);

  // on a phone a row is a card: each number says what it is
  MBS.cards = (table) => {
    const heads = [...table.tHead.rows[0].cells].map((h) => h.textContent);
    for (const row of table.tBodies[0].rows) [...row.cells].forEach((cell, k) => { cell.dataset.h = heads[k]; });
  };
  document.querySelectorAll("table.cards").forEach(MBS.cards);

  const listeners = [];
  MBS.onTheme = (f) => listeners.push(f);
  const changed = () => listeners.forEach((f) => f());
  // the colour that a custom property has now, as the browser resolves it
  MBS.colour = (name) => {
    const probe = MBS.element("i");
    probe.style.cssText = `display: none; color: var(${name})`;
    document.body.append(probe);
    const found = getComputedStyle(probe).color;
    probe.remove();
    return found;
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
  const button = document.querySelector("[data-theme-button]");
  const themes = ["", "light", "dark"];
  const words = { "": "◐ system", light: "☀ light", dark: "☾ dark" };
  const show = () => {
    button.textContent = words[document.documentElement.dataset.theme || ""];
    button.setAttribute("aria-label", `Theme: ${button.textContent.slice(2)}`);
  };
  button.hidden = false;
  show();
  button.addEventListener("click", () => {
    const next = themes[(themes.indexOf(document.documentElement.dataset.theme || "") + 1) % themes.length];
    if (next) document.documentElement.dataset.theme = next;
    else delete document.documentElement.dataset.theme;
    try { next ? localStorage.setItem("mbs-theme", next) : localStorage.removeItem("mbs-theme"); } catch { /* not kept */ }
    show();
    changed();
  });

  // a click on a head asks for an order by its column, another one for the other way; `make` gives a head its button
  MBS.sorters = (heads, make, act) => heads.forEach((head, column) => {
    const sorter = make(head);
    head.append(sorter);
    sorter.addEventListener("click", () => {
      const up = head.getAttribute("aria-sort") !== "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
      act(column, up);
    });
  });
  MBS.wrapped = (head) => MBS.element("button", { type: "button" }, ...head.childNodes);
  // numbers by value, other texts by their words; empty values stay last
  const number = (text) => (text === "inf" ? Infinity : text === "-inf" ? -Infinity : Number(text));
  MBS.ordered = (x, y, up) => {
    if (x === "" || y === "") return (x === "") - (y === "");
    const [p, q] = [number(x), number(y)];
    const order = Number.isNaN(p) || Number.isNaN(q) ? x.localeCompare(y, undefined, { numeric: true }) : p === q ? 0 : p - q;
    return up ? order : -order;
  };
  // long tables come in pages, on a phone of 20 rows: each may be a card. `turn` is called with -1 or 1
  MBS.PAGE = matchMedia("(max-width: 640px)").matches ? 20 : 100;
  MBS.pager = (box, turn) => {
    const [back, on] = ["← Previous", "Next →"].map((textContent, k) => MBS.element("button", { type: "button", textContent, onclick: () => turn(2 * k - 1) }));
    const said = MBS.element("output", { ariaLive: "polite" });
    box.append(back, " ", said, " ", on);
    return (page, count) => {
      const last = Math.max(Math.ceil(count / MBS.PAGE) - 1, 0), now = Math.min(page, last), first = now * MBS.PAGE;
      Object.assign(box, { hidden: last === 0 });
      [back.disabled, on.disabled] = [now === 0, now === last];
      said.textContent = `rows ${first + 1} to ${Math.min(first + MBS.PAGE, count)} of ${count}`;
      return now;
    };
  };
  for (const table of document.querySelectorAll("table.sortable")) {
    const body = table.tBodies[0], rows = [...body.rows], box = MBS.element("p", { className: "links pager" });
    let page = 0, fits = () => true, changed = () => {};
    const draw = () => {
      const own = rows.filter(fits);
      page = shown(page, own.length);
      body.replaceChildren(...own.slice(page * MBS.PAGE, (page + 1) * MBS.PAGE));
      changed(page);
      return own.length;
    };
    const shown = MBS.pager(box, (by) => { page += by; draw(); table.scrollIntoView(); });
    // which rows there are, from which page on; `told` hears of each page that is shown. Returns how many fit
    table.choose = (wanted, from, told) => { [fits, page, changed] = [wanted, from, told]; return draw(); };
    MBS.sorters([...table.tHead.rows[table.tHead.rows.length - 1].cells], MBS.wrapped, (column, up) => {
      const value = (row) => row.cells[column].dataset.v ?? row.cells[column].textContent.trim();
      const by = new Map(rows.map((row) => [row, value(row)]));
      rows.sort((a, b) => MBS.ordered(by.get(a), by.get(b), up));
      page = 0;
      draw();
    });
    if (rows.length > MBS.PAGE) { table.parentElement.after(box); draw(); }
  }
})();
