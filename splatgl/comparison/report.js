// Views of both pictures, filters, marks with the commands that accept them, enlarging, the ground, and the keyboard.
const body = document.body, byId = (id) => document.getElementById(id), all = (selector) => [...document.querySelectorAll(selector)];
const HALF_PERIOD_MS = 600;
const TITLES = { 2: "actual | expected: move the handle", 3: "blink", 4: "actual, with expected over it: move the handle" };
let held = false, expected = false, current = -1;

function turn(to) {
  expected = to;
  body.classList.toggle("turn", to);
  const view = body.dataset.view;
  for (const label of all(".stage figcaption"))
    label.textContent = view === "3" || held ? "blink: " + (to ? "expected" : "actual") : TITLES[view] || "";
}
function setView(number) {
  body.dataset.view = number;
  const radio = document.querySelector(`[name=view][value="${number}"]`);
  if (radio) radio.checked = true;
  turn(false);
}
function zoom(factor) {
  body.classList.toggle("sized", factor > 0);
  for (const picture of all("img")) {
    const own = picture.closest(".detail") ? Math.max(factor, 6) : factor;
    picture.style.width = factor > 0 ? picture.getAttribute("width") * own + "px" : "";
  }
}
function filter() {
  const hidden = all("[data-state][aria-pressed=false]").map((button) => button.dataset.state);
  const word = byId("find") ? byId("find").value.toLowerCase() : "";
  for (const section of all(".case"))
    section.hidden = hidden.includes(section.dataset.state) || !section.querySelector("h2").textContent.toLowerCase().includes(word);
  for (const same of all("details.same")) same.hidden = hidden.includes("same");
}
function marked() {
  return all(".case").filter((section) => section.querySelector(".marked")?.checked);
}
function count() {
  byId("accept").disabled = !marked().length;
  byId("accept").firstElementChild.textContent = marked().length;
}
async function copy(text, button) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // pages from files may not reach the clipboard otherwise
    const area = document.createElement("textarea");
    area.value = text;
    body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  if (button) { button.classList.add("copied"); setTimeout(() => button.classList.remove("copied"), 1200); }
}
const commandOf = (section) => section.querySelector(".accept code").textContent;
const acceptMarked = () => copy(marked().map(commandOf).join("\n") + "\n", byId("accept"));
function go(step) {
  const shown = all(".case:not([hidden])");
  if (!shown.length) return;
  current = Math.min(Math.max(current + step, 0), shown.length - 1);
  all(".current").forEach((section) => section.classList.remove("current"));
  shown[current].classList.add("current");
  shown[current].scrollIntoView({ block: "start" });
}

body.classList.add("checks");
for (const row of all(".row")) {
  const pictures = row.querySelectorAll("img");
  if (pictures.length < 3) continue;
  row.classList.add("paired");
  const stage = document.createElement("figure");
  stage.className = "stage";
  stage.innerHTML = '<figcaption></figcaption><div class="view both"></div><input type="range" min="0" max="100" value="50" aria-label="handle">';
  const both = stage.querySelector(".both"), handle = stage.lastElementChild;
  both.append(pictures[0].cloneNode(), pictures[1].cloneNode());
  both.lastChild.classList.add("over");
  const move = (at) => { handle.value = at; both.style.setProperty("--at", at + "%"); both.style.setProperty("--share", at / 100); };
  handle.oninput = () => move(handle.value);
  both.addEventListener("pointermove", (event) => {
    const box = both.getBoundingClientRect();
    if (body.dataset.view === "2") move(Math.round(100 * (event.clientX - box.left) / box.width));
  });
  both.addEventListener("pointerdown", (event) => { if (body.dataset.view === "3") { held = true; turn(true); event.preventDefault(); } });
  move(50);
  row.append(stage);
}
setView(1);
for (const button of all(".counts button")) button.onclick = () => {
  button.setAttribute("aria-pressed", button.getAttribute("aria-pressed") !== "true");
  filter();
};
if (byId("zoom")) {
  for (const radio of all("[name=view]")) radio.onchange = () => setView(radio.value);
  byId("find").oninput = filter;
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
  byId("accept").onclick = acceptMarked;
  for (const box of all(".marked")) box.onchange = count;
  for (const button of all("button.copy")) button.onclick = () => copy(commandOf(button.closest(".case")) + "\n", button);
  document.addEventListener("pointerup", () => { if (held) { held = false; turn(false); } });
  setInterval(() => { if (body.dataset.view === "3" && !held) turn(!expected); }, HALF_PERIOD_MS);
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.matches("input[type=search]")) { if (event.key === "Escape") event.target.blur(); return; }
    const box = document.querySelector(".current .marked");
    if (event.key >= "1" && event.key <= "5") setView(event.key);
    else if (event.key === "j") go(1);
    else if (event.key === "k") go(-1);
    else if (event.key === "m" && box) { box.checked = !box.checked; count(); }
    else if (event.key === "c") acceptMarked();
    else if (event.key === "/") { byId("find").focus(); event.preventDefault(); }
  });
}
// a link to one case, as summaries and logs name it; #view=3 opens the page in a view
const view = location.hash.match(/^#view=([1-5])$/);
if (view) setView(view[1]);
