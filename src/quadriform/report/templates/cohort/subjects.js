// The table of subjects: sorted by any column, and only those that are asked for.

{
  const table = document.getElementById("subjects"), body = table.tBodies[0], heads = [...table.tHead.rows[0].cells];
  const valueOf = (row, k) => row.cells[k].dataset.value ?? row.cells[k].textContent;

  const sort = (k) => {
    const up = heads[k].getAttribute("aria-sort") !== "ascending", numeric = heads[k].classList.contains("number");
    // what is not known stands last, whichever way
    const order = (a, b) => {
      const [x, y] = [a, b].map((row) => valueOf(row, k));
      if (x === "" || y === "") return (x === "") - (y === "");
      return (up ? 1 : -1) * (numeric ? Number(x) - Number(y) : x.localeCompare(y, "en", { numeric: true }));
    };
    body.replaceChildren(...[...body.rows].sort(order));
    heads.forEach((head, i) => head.setAttribute("aria-sort", i === k ? (up ? "ascending" : "descending") : "none"));
  };

  const choose = () => {
    const gate = document.getElementById("gate").value, word = document.getElementById("search").value.toLowerCase();
    let count = 0;
    for (const row of body.rows) {
      row.hidden = !((gate === "all" || row.dataset.status === gate) && row.cells[0].textContent.toLowerCase().includes(word));
      count += !row.hidden;
    }
    document.getElementById("shown").textContent = `${count} shown`;
  };

  for (const row of body.rows) [...row.cells].forEach((cell, k) => { cell.dataset.name = heads[k].textContent; });
  heads.forEach((head, k) => head.firstElementChild.addEventListener("click", () => sort(k)));
  for (const id of ["gate", "search"]) document.getElementById(id).addEventListener("input", choose);
  choose();
  if (!document.title.startsWith("ready")) document.title = `ready: ${document.title}`;
}
