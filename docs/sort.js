// The head of each long table sorts its rows: by number where both cells hold one, and back again when asked twice.
// Without this file the pages read the same.
document.querySelectorAll("article table:not([class])").forEach((table) => {
  const body = table.tBodies[0];
  if (!table.tHead || !body || body.rows.length < 10) return;
  const text = (row, column) => row.cells[column].textContent.trim();
  [...table.tHead.rows[0].cells].forEach((head, column) => {
    const sort = () => {
      const way = head.ariaSort === "ascending" ? -1 : 1;
      [...table.tHead.rows[0].cells].forEach((each) => each.removeAttribute("aria-sort"));
      head.ariaSort = way > 0 ? "ascending" : "descending";
      const order = (one, other) => {
        const [a, b] = [text(one, column), text(other, column)];
        return way * (a !== "" && b !== "" && !isNaN(a) && !isNaN(b) ? a - b : a.localeCompare(b));
      };
      body.append(...[...body.rows].sort(order));
    };
    head.tabIndex = 0;
    head.title = "Sort by this column";
    head.addEventListener("click", sort);
    head.addEventListener("keydown", (event) => event.key === "Enter" && sort());
  });
});
