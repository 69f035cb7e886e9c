// The first page: which part and number of the matrix is shown, and the table of all cells.
(async () => {
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
      });
    }
  }

  const table = document.querySelector("[data-cells]");
  if (!table) return;
  const { rows, solvers, problems, labels } = await window.MBS.unpack(window.MBS.cells);
  const form = document.querySelector("[data-filters]"), more = document.querySelector("[data-more]");
  const CELL = 0, KIND = 1, STATUS = 2, SOLVER = 3, PROBLEM = 4, LABEL = 5, SETTINGS = 6, WHY = 7, T = 8, ENERGY = 9, ERROR = 10, PHI = 11, WORK = 12, CPU = 13, DRIFT = 14;
  const columns = [SOLVER, PROBLEM, SETTINGS, LABEL, STATUS, T, ENERGY, DRIFT, ERROR, PHI, WORK, CPU];
  const named = { [SOLVER]: (v) => solvers[v][0], [PROBLEM]: (v) => problems[v][0], [LABEL]: (v) => labels[v] };
  const FIRST = 30; // rows shown at first
  const sorting = { column: null, up: true };
  let everything = false;

  const element = (tag, text, attributes = {}) => {
    const e = document.createElement(tag);
    e.textContent = text;
    for (const [k, v] of Object.entries(attributes)) e.setAttribute(k, v);
    return e;
  };
  const entry = (row, column) => {
    const value = row[column], td = document.createElement(column === SOLVER ? "th" : "td");
    if (column === SOLVER) {
      td.scope = "row";
      td.append(element("a", solvers[value][0], { class: "solver", href: solvers[value][1], style: `--c: ${solvers[value][2]}` }));
    } else if (column === PROBLEM) { td.className = "name"; td.append(element("a", problems[value][0], { href: problems[value][1] })); }
    else if (column === SETTINGS) { td.className = "words"; td.append(element("a", value, { href: `cells/${row[CELL]}.html` })); }
    else if (column === STATUS) { td.append(element("span", value, { class: `mark ${row[KIND]}` })); if (row[WHY]) td.append(element("small", row[WHY])); }
    else if (column === LABEL || column === DRIFT) {
      td.className = "short";
      td.textContent = column === LABEL ? labels[value] : value;
    }
    else { td.className = "n"; td.textContent = column === WORK && value !== null ? Math.round(value).toLocaleString("en").replace(/,/g, "\u202f") : column === T && value !== null ? String(value) : window.MBS.number(value); }
    return td;
  };
  const chosen = () => {
    const wanted = Object.fromEntries(new FormData(form)), words = wanted.text.toLowerCase().split(/\s+/).filter(Boolean);
    const out = rows.filter((r) => (!wanted.status || r[KIND] === wanted.status) && (!wanted.solver || r[SOLVER] === Number(wanted.solver))
      && (!wanted.problem || r[PROBLEM] === Number(wanted.problem)) && (!wanted.label || r[LABEL] === Number(wanted.label))
      && words.every((w) => `${named[SOLVER](r[SOLVER])} ${named[PROBLEM](r[PROBLEM])} ${r[SETTINGS]} ${r[WHY]} ${r[STATUS]} ${r[DRIFT]}`.toLowerCase().includes(w)));
    if (sorting.column === null) return out;
    const key = (r) => (named[sorting.column] ? named[sorting.column](r[sorting.column]) : r[sorting.column]);
    return out.sort((a, b) => {
      const [x, y] = [key(a), key(b)];
      if (x === null || y === null || x === "" || y === "") return (x === null || x === "") - (y === null || y === "");
      const order = typeof x === "string" ? x.localeCompare(y, undefined, { numeric: true }) : x - y;
      return sorting.up ? order : -order;
    });
  };
  const render = () => {
    const own = chosen(), some = everything ? own : own.slice(0, FIRST);
    table.tBodies[0].replaceChildren(...some.map((row) => {
      const tr = document.createElement("tr");
      tr.className = row[KIND];
      tr.append(...columns.map((c) => entry(row, c)));
      return tr;
    }));
    document.querySelector("[data-count]").textContent = `${own.length} of ${rows.length} cells`;
    more.hidden = some.length === own.length;
    more.textContent = `Show all ${own.length}`;
  };
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, k) => {
    const button = element("button", head.textContent, { type: "button" });
    head.replaceChildren(button);
    button.addEventListener("click", () => {
      sorting.up = sorting.column === columns[k] ? !sorting.up : true;
      sorting.column = columns[k];
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", sorting.up ? "ascending" : "descending");
      render();
    });
  });
  for (const [name, value] of new URLSearchParams(location.search)) if (form.elements[name]) form.elements[name].value = value;
  form.addEventListener("input", render);
  form.addEventListener("reset", () => setTimeout(render));
  form.addEventListener("submit", (e) => e.preventDefault());
  more.addEventListener("click", () => { everything = true; render(); });
  render();
})();
