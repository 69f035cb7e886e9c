// Filters over items, grids that the arrow keys walk through, and switches between plots.
(() => {
  // [data-filters="#list"] holds selects named after data-* attributes of the items in the list (lists are JSON arrays),
  // and perhaps a search for words in their text; what is chosen is in the address, as `list.name=value`
  for (const bar of document.querySelectorAll("[data-filters]")) {
    const list = document.querySelector(bar.dataset.filters);
    const items = [...list.querySelectorAll("[data-item]")];
    const selects = [...bar.querySelectorAll("select")];
    const said = bar.querySelector("[role=status]"), search = bar.querySelector("input[type=search]");
    const has = (item, name, wanted) => {
      const own = item.dataset[name] ?? "";
      return own.startsWith("[") ? JSON.parse(own).includes(wanted) : own === wanted;
    };
    const table = items[0]?.tagName === "TR" ? items[0].closest("table") : null, asked = new URLSearchParams(location.search), key = (of) => `${list.id}.${of.name || of}`;
    const fields = search ? [...selects, search] : selects;
    for (const f of fields) {
      const value = asked.get(key(f));
      if (value !== null && (f === search || [...f.options].some((o) => o.value === value))) f.value = value;
    }
    if (fields.some((f) => asked.has(key(f)))) for (let e = list; e; e = e.parentElement) if (e.tagName === "DETAILS") e.open = true;
    const keep = (page) => {
      const kept = new URLSearchParams(location.search), set = (of, value) => (value ? kept.set(key(of), value) : kept.delete(key(of)));
      fields.forEach((f) => set(f, f.value === "*" ? "" : f.value));
      set("page", page ? page + 1 : "");
      try { history.replaceState(null, "", `${location.pathname}${kept.size ? "?" : ""}${kept}${location.hash}`); } catch { /* not kept */ }
    };
    const apply = (page = 0) => {
      const words = search ? search.value.toLowerCase().split(/\s+/).filter(Boolean) : [];
      const fits = (item) => {
        const text = words.length ? item.textContent.toLowerCase() : "";
        return words.every((w) => text.includes(w)) && selects.every((s) => s.value === "*" || has(item, s.name, s.value));
      };
      const shown = table ? table.choose(fits, page, keep) : items.filter((item) => !(item.hidden = !fits(item))).length;
      if (!table) keep(0);
      const chosen = words.length > 0 || selects.some((s) => s.value !== "*"); // what is found in a folded part is shown
      for (const part of list.querySelectorAll("[data-part]")) {
        part.hidden = !part.querySelector("[data-item]:not([hidden])");
        if (chosen && part.tagName === "DETAILS") part.open = true;
      }
      if (said) said.textContent = `${shown} of ${items.length} shown`;
    };
    fields.forEach((f) => f.addEventListener(f === search ? "input" : "change", () => apply()));
    for (const button of document.querySelectorAll(`[data-set-filter]`)) {
      button.addEventListener("click", () => {
        const [name, value] = JSON.parse(button.dataset.setFilter);
        const select = selects.find((s) => s.name === name);
        if (select) { select.value = select.value === value ? "*" : value; apply(); }
      });
    }
    bar.hidden = false;
    apply(Math.max(Number(asked.get(key("page"))) - 1 || 0, 0));
  }

  // [data-grid]: one stop of the tab key, arrows move inside; what a box says is read out below
  for (const grid of document.querySelectorAll("[data-grid]")) {
    const boxes = [...grid.querySelectorAll(".box")];
    const out = grid.querySelector(".readout");
    const tell = (box) => { if (out && box) out.textContent = box.title = box.getAttribute("aria-label"); };
    boxes.forEach((box, k) => { box.tabIndex = k ? -1 : 0; });
    grid.addEventListener("focusin", (e) => tell(e.target.closest(".box")));
    grid.addEventListener("mouseover", (e) => tell(e.target.closest(".box")));
    grid.addEventListener("keydown", (e) => {
      const here = boxes.indexOf(document.activeElement);
      const step = { ArrowRight: 1, ArrowLeft: -1, Home: -Infinity, End: Infinity }[e.key];
      let next;
      if (here < 0) return;
      if (step) next = boxes[Math.min(Math.max(here + step, 0), boxes.length - 1)];
      else if (e.key === "ArrowDown" || e.key === "ArrowUp") {
        const [x, y] = [boxes[here].getBoundingClientRect(), e.key === "ArrowDown" ? 1 : -1];
        const gap = (b) => { const r = b.getBoundingClientRect(); return [(r.top - x.top) * y, Math.abs(r.left - x.left)]; };
        next = boxes.filter((b) => gap(b)[0] > 4).sort((a, b) => gap(a)[0] - gap(b)[0] || gap(a)[1] - gap(b)[1])[0];
      }
      if (!next) return;
      e.preventDefault();
      boxes.forEach((b) => { b.tabIndex = b === next ? 0 : -1; });
      next.focus();
    });
  }

  // [data-choose]: selects whose values, joined by "-", name the figures [data-choice] to show
  for (const bar of document.querySelectorAll("[data-choose]")) {
    const selects = [...bar.querySelectorAll("select")];
    const figures = [...document.querySelectorAll(`${bar.dataset.choose} [data-choice]`)];
    const apply = () => {
      const wanted = selects.map((s) => s.value).join("-");
      figures.forEach((f) => { f.hidden = f.dataset.choice !== wanted; });
      for (const part of document.querySelectorAll(`${bar.dataset.choose}`)) {
        const none = part.querySelector("[data-none]");
        if (none) none.hidden = [...part.querySelectorAll("[data-choice]")].some((f) => !f.hidden);
      }
      dispatchEvent(new Event("resize"));
    };
    selects.forEach((s) => s.addEventListener("change", apply));
    bar.hidden = false;
    apply();
  }
})();
