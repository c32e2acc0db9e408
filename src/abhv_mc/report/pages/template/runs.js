"use strict";
// Sort and filter the campaigns, and show the command that compares two selected campaigns.
(() => {
  const body = document.querySelector("#runs tbody");
  const rows = [...body.rows];
  const heads = [...document.querySelectorAll("#runs thead th")];
  const boxes = rows.flatMap((row) => [...row.querySelectorAll("input")]);
  const pages = JSON.parse(document.getElementById("comparisons").textContent);
  const count = document.getElementById("count");
  const words = document.getElementById("compare");
  const key = (row, k) => row.cells[k]?.dataset.sort ?? row.cells[k]?.textContent.trim() ?? "";

  function sort(k) {
    const falls = heads[k].getAttribute("aria-sort") === "ascending";
    heads.forEach((head) => head.removeAttribute("aria-sort"));
    heads[k].setAttribute("aria-sort", falls ? "descending" : "ascending");
    rows.sort((a, b) => (falls ? -1 : 1) * key(a, k).localeCompare(key(b, k), "en", { numeric: true }));
    body.append(...rows);
  }

  function filter(text) {
    const parts = text.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of rows) {
      const held = row.textContent.toLowerCase();
      row.hidden = !parts.every((part) => held.includes(part));
    }
    count.textContent = `${rows.filter((row) => !row.hidden).length} of ${rows.length} ${rows.length === 1 ? "campaign" : "campaigns"}`;
  }

  function compare() {
    const [a, b, ...more] = boxes.filter((box) => box.checked).map((box) => box.dataset)
      .sort((one, other) => one.started.localeCompare(other.started));  // earlier campaign first
    words.textContent = more.length ? "Tick two campaigns only." : words.dataset.hint;
    if (!b || more.length) return;
    const out = `${a.name} against ${b.name}`.replace(/[^\w.-]+/g, "_");
    const command = document.createElement("code");
    command.textContent = `abhv-mc compare ${a.folder} ${b.folder} -o ${out}`;
    words.replaceChildren("Compare them with ", command);
    const page = pages[`${a.digest} ${b.digest}`] ?? pages[`${b.digest} ${a.digest}`];
    if (page) {
      const link = document.createElement("a");
      link.href = encodeURI(page);
      link.textContent = "their comparison";
      words.append(" or open ", link, ".");
    }
  }

  heads.forEach((head, k) => head.querySelector("button")?.addEventListener("click", () => sort(k)));
  document.getElementById("filter").addEventListener("input", (event) => filter(event.target.value));
  boxes.forEach((box) => box.addEventListener("change", compare));
  filter("");
  compare();
})();
