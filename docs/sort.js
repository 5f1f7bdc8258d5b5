// The head of each long table sorts its rows: by number where both cells hold one, and back again when asked twice.
// A table of many rows scrolls in a box, below a field that keeps the rows with all typed words.
// Without this file the pages read the same.
const MANY = 25;
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
        if (!a || !b) return !a - !b;  // empty cells last, both ways
        return way * (a !== "" && b !== "" && !isNaN(a) && !isNaN(b) ? a - b : a.localeCompare(b));
      };
      body.append(...[...body.rows].sort(order));
    };
    head.tabIndex = 0;
    head.title = "Sort by this column";
    head.addEventListener("click", sort);
    head.addEventListener("keydown", (event) => event.key === "Enter" && sort());
  });
  const box = table.closest(".csv");
  if (!box || body.rows.length < MANY) return;
  const field = document.createElement("input");
  Object.assign(field, { type: "search", className: "filter", placeholder: `Filter ${body.rows.length} rows` });
  field.ariaLabel = "Keep the rows that hold all of these words";
  field.addEventListener("input", () => {
    const words = field.value.toLowerCase().split(/\s+/);
    for (const row of body.rows) row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word));
  });
  box.before(field);
  box.classList.add("long");
});
