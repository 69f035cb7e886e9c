// The first page: which part, number and rows of the matrix are shown, in which order; and the table of all runs.
(async () => {
  // the matrix and the tables of variants: rows by a solver's column; what has no number there stays last
  const MEASURES = { error: "error", energy: "energy error", phi: "constraint error", cost: "CPU time" };
  const LAST = { good: 0, inaccurate: 0, wrong: 0, failed: 1, refused: 2 };
  const superscripts = (text) => [...text].map((c) => "-0123456789"["⁻⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(c)] ?? c).join("");
  // an entry's number as it reads: 1.23×10⁻⁵ m, 45.6 ms, ∞ J; null where there is none
  const read = (text) => {
    if (text.startsWith("∞")) return Infinity;
    if (text.startsWith("below") || text.startsWith("<")) return 0;
    const found = text.match(/^−?[\d.]+(?:×10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?/);
    if (!found) return null;
    const value = Number(superscripts(found[0].replace("−", "-").replace("×10", "e")));
    return / ms$/.test(text) ? value / 1000 : value;
  };
  const sortable = (table) => {
    const body = table.tBodies[0], all = [...body.rows], heads = [...table.tHead.rows[0].cells], now = { column: null, up: true };
    const measure = () => (MEASURES[table.dataset.shown] ? table.dataset.shown : "error");
    const rank = (row) => {
      const cell = row.cells[now.column];
      if (now.column === 0) return [0, all.indexOf(row)];
      if (table.dataset.shown === undefined) return cell.dataset.v === undefined ? [1, 0] : [0, Number(cell.dataset.v)];
      const shown = cell.querySelector(`.${measure()} dd:last-child`), value = shown && read(shown.textContent);
      const late = LAST[cell.dataset.ended] ?? 3;
      return late || value !== null ? [late, value ?? 0] : [0.5, 0];
    };
    const sort = () => {
      heads.forEach((head, k) => {
        const button = head.querySelector("button"), by = k === 0 ? "problem" : table.dataset.shown === undefined ? "the share that succeeded" : MEASURES[measure()];
        button.setAttribute("aria-label", k === 0 ? "Sort by problem, in the paper's order" : `Sort by ${by} of ${head.querySelector(".solver").textContent}`);
        button.title = button.getAttribute("aria-label");
      });
      if (now.column === null) return;
      const order = ([late, x], [later, y]) => late - later || (late || x === y ? 0 : (x < y ? -1 : 1) * (now.up ? 1 : -1));
      body.append(...all.map((row) => [rank(row), row]).sort((a, b) => order(a[0], b[0])).map((pair) => pair[1]));
    };
    const sorter = (head) => { head.append(" "); return MBS.element("button", { type: "button", textContent: "sort", className: "sorter" }); };
    MBS.sorters(heads, sorter, (column, up) => { Object.assign(now, { column, up }); sort(); });
    sort();
    return { all, sort, folded: table.closest("details") };
  };
  const tables = [...document.querySelectorAll("table.matrix, table[data-tally]")].map(sortable);
  // rows of all of them by words in the problem's head and by how their runs ended
  const filterRows = (box) => {
    const [words, has] = ["problem", "has"].map((key) => box.querySelector(`[data-rows=${key}]`)), count = box.querySelector("[data-rows-count]");
    const fits = (row) => {
      const ran = [...row.cells].flatMap((c) => (c.dataset.has === undefined ? [] : [c.dataset.has.split(" ")]));
      const ended = !has.value || (has.value === "succeeded" ? ran.length && ran.every((e) => e.includes("succeeded")) : ran.some((e) => e.includes(has.value)));
      const head = row.cells[0].textContent.toLowerCase();
      return ended && words.value.toLowerCase().split(/\s+/).every((w) => head.includes(w));
    };
    const filter = () => {
      for (const { all, folded } of tables) {
        all.forEach((row) => { row.hidden = !fits(row); });
        if (folded) folded.hidden = all.every((row) => row.hidden);
      }
      const own = [...document.querySelectorAll("[data-part-of]:not([hidden]) table.matrix tbody tr")];
      count.textContent = words.value || has.value ? `${own.filter((row) => !row.hidden).length} of ${own.length} rows` : "";
    };
    for (const kind of ["input", "change"]) box.addEventListener(kind, filter);
  };

  const switches = document.querySelector("[data-matrix-switches]");
  if (switches) {
    const parts = [...document.querySelectorAll("[data-part-of]")], select = switches.querySelector("[data-part]");
    const show = () => parts.forEach((p) => { p.hidden = select && p.dataset.partOf !== select.value; });
    switches.hidden = false;
    if (select) {
      parts.forEach((p) => p.querySelector("h3").classList.add("hidden"));
      select.addEventListener("change", show);
      show();
    }
    const buttons = [...switches.querySelectorAll("[data-measure]")];
    for (const b of buttons) {
      b.addEventListener("click", () => {
        buttons.forEach((other) => other.setAttribute("aria-pressed", other === b));
        document.querySelectorAll("[data-shown]").forEach((t) => { t.dataset.shown = b.dataset.measure; });
        tables.forEach(({ sort }) => sort());
      });
    }
    filterRows(switches);
  }

  const table = document.querySelector("[data-runs]");
  if (!table) return;
  const { rows, solvers, problems, labels } = await MBS.unpack(MBS.runs);
  const form = document.querySelector("[data-filters]");
  const turned = MBS.pager(document.querySelector("[data-pager]"), (by) => { changed(page + by); form.scrollIntoView(); });
  const RUN = 0, KIND = 1, STATUS = 2, SOLVER = 3, PROBLEM = 4, LABEL = 5, SETTINGS = 6, WHY = 7, T = 8, ENERGY = 9, ERROR = 10, PHI = 11, WORK = 12, CPU = 13, DRIFT = 14;
  const columns = [SOLVER, PROBLEM, SETTINGS, LABEL, STATUS, T, ENERGY, DRIFT, ERROR, PHI, WORK, CPU];
  const named = { [SOLVER]: (v) => solvers[v][0], [PROBLEM]: (v) => problems[v][0], [LABEL]: (v) => labels[v] };
  const ROWS = MBS.PAGE;
  const asked = new URLSearchParams(location.search);
  let sorting = { column: null, up: true }, page = Math.max(Number(asked.get("page")) - 1 || 0, 0);

  const link = (textContent, href) => MBS.element("a", { textContent, href });
  const entry = (row, column) => {
    const value = row[column], td = document.createElement(column === SOLVER ? "th" : "td");
    if (column === SOLVER) {
      td.scope = "row";
      const [name, url, colour] = solvers[value];
      td.append(Object.assign(link(name, url), { className: "solver", style: `--c: ${colour}` }));
    } else if (column === PROBLEM) { td.className = "name"; td.append(link(...problems[value])); }
    else if (column === SETTINGS) { td.className = "words"; td.append(link(value, `runs/${row[RUN]}.html`)); }
    else if (column === STATUS) { td.className = "status"; td.append(MBS.element("span", { textContent: value, className: `mark ${row[KIND]}` })); if (row[WHY]) td.append(MBS.element("small", { textContent: row[WHY] })); }
    else if (column === LABEL || column === DRIFT) { td.className = "short"; td.textContent = column === LABEL ? labels[value] : value; }
    else { td.className = "n"; td.textContent = column === WORK && value !== null ? Math.round(value).toLocaleString("en").replace(/,/g, "\u202f") : column === T && value !== null ? String(value) : column === CPU && value === 0 ? "below the clock" : MBS.number(value); }
    return td;
  };
  const chosen = () => {
    const wanted = Object.fromEntries(new FormData(form)), words = wanted.text.toLowerCase().split(/\s+/).filter(Boolean);
    const out = rows.filter((r) => (!wanted.status || r[KIND] === wanted.status) && (!wanted.solver || r[SOLVER] === Number(wanted.solver))
      && (!wanted.problem || r[PROBLEM] === Number(wanted.problem)) && (!wanted.label || r[LABEL] === Number(wanted.label))
      && words.every((w) => `${named[SOLVER](r[SOLVER])} ${named[PROBLEM](r[PROBLEM])} ${r[SETTINGS]} ${r[WHY]} ${r[STATUS]} ${r[DRIFT]}`.toLowerCase().includes(w)));
    if (sorting.column === null) return out;
    const key = (r) => (named[sorting.column] ? named[sorting.column](r[sorting.column]) : r[sorting.column]);
    return out.sort((a, b) => MBS.ordered(key(a) ?? "", key(b) ?? "", sorting.up));
  };
  // what is chosen is in the address: a link to it shows the same rows
  const address = () => {
    const kept = new URLSearchParams([...new FormData(form)].filter(([, v]) => v));
    if (sorting.column !== null) kept.set("sort", `${sorting.up ? "" : "-"}${columns.indexOf(sorting.column)}`);
    if (page) kept.set("page", page + 1);
    try { history.replaceState(null, "", `?${kept}${location.hash}`.replace(/^\?(?=#|$)/, location.pathname)); } catch { /* not kept */ }
  };
  const render = () => {
    const own = chosen();
    page = turned(page, own.length);
    const some = own.slice(page * ROWS, (page + 1) * ROWS);
    table.tBodies[0].replaceChildren(...some.map((row) => MBS.element("tr", { className: row[KIND] }, ...columns.map((c) => entry(row, c)))));
    MBS.cards(table);
    document.querySelector("[data-count]").textContent = `${own.length} of ${rows.length} runs`;
  };
  const changed = (to = 0) => { page = to; render(); address(); };
  const heads = [...table.tHead.rows[0].cells];
  MBS.sorters(heads, MBS.wrapped, (k, up) => { sorting = { column: columns[k], up }; changed(); });
  for (const [name, value] of asked) if (form.elements[name]) form.elements[name].value = value;
  const by = (asked.get("sort") || "").match(/^(-?)(\d+)$/);
  if (by && columns[by[2]] !== undefined) {
    sorting = { column: columns[by[2]], up: !by[1] };
    heads[by[2]].setAttribute("aria-sort", by[1] ? "descending" : "ascending");
  }
  form.addEventListener("input", () => changed());
  form.addEventListener("reset", () => setTimeout(changed));
  form.addEventListener("submit", (e) => e.preventDefault());
  render();
})();
