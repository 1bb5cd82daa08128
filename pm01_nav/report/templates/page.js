// The page around: theme, sorting of tables, one entry's lines before the others.

const root = document.documentElement;
const dark = matchMedia("(prefers-color-scheme: dark)");

const themeButton = document.querySelector("#theme");
const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : dark.matches);

function showTheme() {
  themeButton.textContent = isDark() ? "Light" : "Dark";
  resize();
}

themeButton.addEventListener("click", () => {
  root.dataset.theme = isDark() ? "light" : "dark";
  showTheme();
});
dark.addEventListener("change", showTheme);

function sortBy(header) {
  const table = header.closest("table");
  const rows = [...table.tBodies[0].rows];
  const falling = header.getAttribute("aria-sort") !== "descending";
  const column = header.cellIndex;
  const value = (row) => row.cells[column].dataset.value ?? row.cells[column].textContent;
  const order = falling ? -1 : 1;
  rows.sort((one, other) => {
    const [a, b] = [value(one), value(other)];
    // What has no number comes last, whichever way.
    if (a === "" || b === "") return (a === "") - (b === "");
    return order * (column ? a - b : -a.localeCompare(b));
  });
  table.querySelectorAll("th[aria-sort]").forEach((other) => other.removeAttribute("aria-sort"));
  header.setAttribute("aria-sort", falling ? "descending" : "ascending");
  table.tBodies[0].append(...rows);
}

document.querySelectorAll("th > button").forEach((button) => {
  button.addEventListener("click", () => sortBy(button.parentElement));
});

// Pointing at a name in a legend dims the other lines; a click keeps it so.
let kept = null;

function bringForward(entry) {
  document.querySelectorAll("[data-entry]").forEach((element) => {
    element.classList.toggle("dim", entry !== null && element.dataset.entry !== entry);
  });
}

document.querySelectorAll("button[data-entry]").forEach((button) => {
  const { entry } = button.dataset;
  button.addEventListener("pointerenter", () => bringForward(entry));
  button.addEventListener("pointerleave", () => bringForward(kept));
  button.addEventListener("click", () => {
    kept = kept === entry ? null : entry;
    document.querySelectorAll("button[data-entry]").forEach((other) => {
      other.setAttribute("aria-pressed", String(other.dataset.entry === kept));
    });
    bringForward(kept);
  });
});

window.addEventListener("beforeprint", () => {
  document.querySelectorAll("details").forEach((details) => { details.open = true; });
});

showTheme();
followAddress();
