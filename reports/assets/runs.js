// The table of all runs: filtered, sorted and paged; what is chosen is in the address.
(async () => {
  const table = document.querySelector("[data-runs]");
  if (!table) return;
  const { rows, solvers, problems, labels, shows } = await MBS.unpack(MBS.runs);
  const form = document.querySelector("[data-filters]");
  const turned = MBS.pager(document.querySelector("[data-pager]"), (by) => { changed(page + by); form.scrollIntoView(); });
  const RUN = 0, KIND = 1, STATUS = 2, SOLVER = 3, PROBLEM = 4, LABEL = 5, SETTINGS = 6, WHY = 7, FIRST = 8;
  const columns = [SOLVER, PROBLEM, SETTINGS, LABEL, STATUS, ...shows.map((_, k) => FIRST + k)];
  // numbers as the functions of reports/model/words.py of these names write them
  const written = {
    format_count: (v) => Math.round(v).toLocaleString("en").replace(/,/g, "\u202f"),
    time: String,
    format_cpu_time: (v) => (v === 0 ? "below the clock" : MBS.number(v)),
    format_signed: (v) => (v > 0 ? "+" : "") + MBS.number(v),
  };
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
    else if (column === LABEL || !shows[column - FIRST]) { td.className = "short"; td.textContent = column === LABEL ? labels[value] : value; }
    else { td.className = "n"; td.textContent = value === null ? MBS.number(value) : (written[shows[column - FIRST]] || MBS.number)(value); }
    return td;
  };
  const chosen = () => {
    const wanted = Object.fromEntries(new FormData(form)), words = wanted.text.toLowerCase().split(/\s+/).filter(Boolean);
    const out = rows.filter((r) => (!wanted.status || r[KIND] === wanted.status) && (!wanted.solver || r[SOLVER] === Number(wanted.solver))
      && (!wanted.problem || r[PROBLEM] === Number(wanted.problem)) && (!wanted.label || r[LABEL] === Number(wanted.label))
      && words.every((w) => `${named[SOLVER](r[SOLVER])} ${named[PROBLEM](r[PROBLEM])} ${r[SETTINGS]} ${r[WHY]} ${r[STATUS]} ${r.slice(FIRST).filter((v) => typeof v === "string").join(" ")}`.toLowerCase().includes(w)));
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
