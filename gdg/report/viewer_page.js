// What every report's page has: camera, pointers, tables and buttons, around viewer_draw.js.
// The page's own script defines currentView().
// Text reaches the page as textContent only, because names come from files that nobody checked.

// -- camera -------------------------------------------------------------------------------------

function lookFrom(which) {
  const look = currentView(), eye = look.eyes[which];
  camera.azimuth = Math.atan2(eye[1], eye[0]);
  camera.elevation = Math.asin(Math.max(-1, Math.min(1, eye[2])));
  camera.target = look.center.slice();
  const canvas = byId("canvas"), aspect = canvas.clientWidth / Math.max(1, canvas.clientHeight);
  camera.distance = (1.05 * look.radius) / Math.sin(FIELD_OF_VIEW / 2) / Math.min(1, aspect);
  state.moved = false;
  redraw();
}

function orbit(dx, dy) {
  camera.azimuth -= 0.008 * dx;
  camera.elevation = Math.max(-1.56, Math.min(1.56, camera.elevation + 0.008 * dy));
}

function pan(dx, dy) {
  const [x, y] = axes();
  const step = (2 * camera.distance * Math.tan(FIELD_OF_VIEW / 2)) / byId("canvas").clientHeight;
  camera.target = camera.target.map((value, i) => value + step * (dy * y[i] - dx * x[i]));
}

function zoom(factor) {
  camera.distance = Math.max(0.05, Math.min(5, camera.distance * factor));
}

function listenToPointers(canvas) {
  const pointers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const dx = event.clientX - before[0], dy = event.clientY - before[1];
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      const gap = (at) => Math.max(1, Math.hypot(at[0] - other[0], at[1] - other[1]));
      zoom(gap(before) / gap([event.clientX, event.clientY]));
      pan(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons & 6) pan(dx, dy);
    else orbit(dx, dy);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    state.moved = true;
    redraw();
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(0.0012 * event.deltaY * (event.deltaMode === 1 ? 16 : 1)));
    state.moved = true;
    redraw();
  }, { passive: false });
}

// -- page ---------------------------------------------------------------------------------------

function make(tag, text = "", className = "", ...children) {
  const made = document.createElement(tag);
  if (text) made.textContent = text;
  if (className) made.className = className;
  made.append(...children);
  return made;
}

function say(text) {
  byId("empty").textContent = text;
  byId("empty").style.display = "block";
}

const number = (value, digits = 1) => (value === null || value === undefined ? "-" : value.toFixed(digits));
const millimetres = (metres, digits = 1) => (metres === null || metres === undefined ? "-" : `${number(1000 * metres, digits)} mm`);
const degrees = (radians) => (radians === null ? "-" : `${number((180 / Math.PI) * radians)}°`);

function gauge(low, high, mark = false) {
  const fill = make("i"), cell = make("td", "", mark ? "gauge mark" : "gauge", make("div", "", "", fill));
  fill.style.left = `${100 * low}%`;
  if (!mark) fill.style.width = `${100 * (high - low)}%`;
  return cell;
}

function table(titles, rows) {
  const made = make("table");
  made.append(make("tr", "", "", ...titles.map((title) => make("th", title))));
  for (const cells of rows) made.append(make("tr", "", "", ...cells.map((cell) => (cell instanceof Node ? cell : make("td", cell)))));
  return made;
}

function facts(pairs) {
  return make("dl", "", "", ...pairs.flatMap(([name, value]) => [make("dt", name), make("dd", value)]));
}

function folded(title, text) {
  return make("details", "", "", make("summary", title), make("pre", text));
}

function button(group, text, hint, act) {
  const made = make("button", text);
  made.type = "button";
  made.title = hint;
  made.addEventListener("click", act);
  byId(group).append(made);
  return made;
}

const keys = {};

function addToggle(key, name, text) {
  const made = button("toggles", text, `key ${key}`, () => {
    state.shown[name] = !state.shown[name];
    made.setAttribute("aria-pressed", String(state.shown[name]));
    redraw();
  });
  made.setAttribute("aria-pressed", String(state.shown[name]));
  keys[key] = () => made.click();
}

function setTheme(name) {
  document.documentElement.dataset.theme = name;
  byId("theme").textContent = name === "dark" ? "Light" : "Dark";
  byId("canvas").style.background = "radial-gradient(circle at 50% 42%, var(--sky), var(--ground))";
  readTheme();
}

function addCommonControls(hint) {
  addToggle("g", "grid", "Grid");
  button("views", "View A", "key a", (keys.a = () => lookFrom(0)));
  button("views", "View B", "key b", (keys.b = () => lookFrom(1)));
  byId("hint").textContent = `drag: orbit · shift or right drag: pan · wheel: zoom · ${hint}grid: 10 mm`;
}

function startViewer(label) {
  byId("title").textContent = data.title;
  byId("summary").textContent = data.summary;
  byId("list").setAttribute("aria-label", label);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  setTheme(dark.matches ? "dark" : "light");
  dark.addEventListener("change", () => setTheme(dark.matches ? "dark" : "light"));
  byId("theme").addEventListener("click", () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));
  setUp();
  listenToPointers(byId("canvas"));
  // at once, before the browser paints: a picture of the old size would be stretched for a frame
  new ResizeObserver(() => draw()).observe(byId("canvas"));
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
    if (event.target instanceof HTMLInputElement) return;
    event.preventDefault();
    keys[event.key]();
  });
}
