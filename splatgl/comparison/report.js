// Enlarging, the ground, the difference's gain, and both pictures in turn.
const body = document.body, byId = (id) => document.getElementById(id);
const HALF_PERIOD_MS = 600;
let held = false, turn = false;

function show(expected) {
  body.classList.toggle("turn", expected);
  for (const label of document.querySelectorAll(".now")) label.textContent = "in turn: " + (expected ? "expected" : "actual");
}
function zoom(factor) {
  body.classList.toggle("sized", factor > 0);
  for (const picture of document.querySelectorAll("img")) {
    const own = picture.closest(".detail") ? Math.max(factor, 6) : factor;
    picture.style.width = factor > 0 ? picture.getAttribute("width") * own + "px" : "";
  }
}
body.classList.add("checks");
for (const view of document.querySelectorAll(".view.flicker")) {
  const [actual, expected] = view.closest(".row").querySelectorAll("img");
  view.append(actual.cloneNode(), expected.cloneNode());
  view.lastChild.classList.add("over");
}
if (byId("zoom")) {
  byId("zoom").onchange = (event) => zoom(Number(event.target.value));
  byId("ground").onchange = (event) => {
    body.classList.remove("checks", "black", "white");
    body.classList.add(event.target.value);
  };
  byId("gain").oninput = (event) => {
    const gain = 2 ** Number(event.target.value);
    body.style.setProperty("--gain", gain);
    event.target.nextElementSibling.textContent = gain < 10 ? gain.toFixed(1).replace(".0", "") : Math.round(gain);
  };
  if (matchMedia("(prefers-reduced-motion: reduce)").matches) byId("flicker").checked = false;
  document.addEventListener("pointerdown", (event) => { if (event.target.closest(".flicker")) { held = true; show(true); event.preventDefault(); } });
  document.addEventListener("pointerup", () => { if (held) { held = false; show(false); } });
  show(false);
  setInterval(() => {
    if (held) return;
    turn = byId("flicker").checked && !turn;
    show(turn);
  }, HALF_PERIOD_MS);
}
