// The report's page: camera, pointers, lists and tables, around the drawing of viewer_draw.js.
// Text reaches the page as textContent only, because names come from files that nobody checked.

// -- camera -------------------------------------------------------------------------------------

function lookFrom(which) {
  const grasp = data.grasps[state.grasp], look = grasp ? grasp.view : data.view, eye = look.eyes[which];
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

const largest = (values) => (values.includes(null) || !values.length ? null : Math.max(...values));

function chip(grasp) {
  if (!grasp.verdict) return make("span", "not simulated", "chip unknown");
  return grasp.verdict.success ? make("span", "pass", "chip pass") : make("span", grasp.verdict.failure || "fail", "chip fail");
}

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

function verdictParts(verdict) {
  const longest = Math.max(...verdict.displacement_m.map((value) => value || 0), 1e-9);
  const passes = verdict.shift_successes.filter(Boolean).length;
  return [
    make("div", `${verdict.protocol} · ${verdict.engine}${verdict.refined ? " · refined" : ""}`, "faint"),
    facts([
      ["moved, at most", millimetres(largest(verdict.displacement_m))],
      ["without a hand it moves", millimetres(verdict.free_displacement_m, 0)],
      ["drift while closing", millimetres(verdict.drift_m)],
      ["penetration before", `${number(verdict.penetration_start_mm, 2)} mm`],
      ["penetration after settling", `${number(verdict.penetration_end_mm, 2)} mm`],
      ["stability over shifts", `${passes}/${verdict.shift_successes.length}`],
    ]),
    make("h2", "Push directions"),
    table(["push", "", "moved", "rotated", "held"], verdict.displacement_m.map((value, i) => [
      data.directions[i] ?? String(i), gauge(0, (value || 0) / longest), millimetres(value),
      degrees(verdict.rotation_rad[i] ?? null), verdict.contact_kept[i] ? "yes" : "no",
    ])),
  ];
}

function jointTable(values) {
  return table(["joint", "range", "", ""], values.map((value, i) => {
    const joint = data.joints[i], share = (value - joint.lower) / (joint.upper - joint.lower || 1);
    const texts = joint.unit === "m" ? [millimetres(value), ""] : [degrees(value), `${number(value, 3)} rad`];
    return [joint.name, gauge(Math.max(0, Math.min(1, share)), 0, true), ...texts];
  }));
}

function folded(title, text) {
  return make("details", "", "", make("summary", title), make("pre", text));
}

function showDetails() {
  const grasp = data.grasps[state.grasp], side = byId("side");
  side.replaceChildren();
  if (grasp) {
    side.append(make("div", "", "heading", make("span", `Grasp #${grasp.index}`), chip(grasp)));
    if (grasp.verdict) side.append(...verdictParts(grasp.verdict));
    else if (grasp.status) side.append(make("div", grasp.status, "faint"));
    side.append(make("h2", "Joints"), jointTable(grasp.joints));
    const energies = Object.entries(grasp.energies);
    if (energies.length) side.append(make("h2", "Energies"), facts(energies.map(([name, value]) => [name, value === null ? "-" : value.toPrecision(4)])));
  }
  if (data.config_text) side.append(folded("Configuration", data.config_text));
  if (data.provenance_text) side.append(folded("Provenance", data.provenance_text));
}

function choose(index) {
  if (!data.grasps.length) return;
  state.grasp = (index + data.grasps.length) % data.grasps.length;
  [...byId("list").children].forEach((entry, i) => entry.setAttribute("aria-current", String(i === state.grasp)));
  byId("list").children[state.grasp].scrollIntoView({ block: "nearest", inline: "nearest" });
  loadGrasp();
  showDetails();
  if (!state.moved) lookFrom(0);
  redraw();
}

function listEntry(grasp, index) {
  const entry = make("button", "", "", make("span", `#${grasp.index}`, "number"), chip(grasp));
  if (grasp.verdict) entry.append(make("span", millimetres(largest(grasp.verdict.displacement_m)), "note"));
  entry.type = "button";
  entry.addEventListener("click", () => choose(index));
  return entry;
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

function buildControls() {
  button("steps", "‹ Previous", "key ←", (keys.ArrowLeft = () => choose(state.grasp - 1)));
  button("steps", "Next ›", "key →", (keys.ArrowRight = () => choose(state.grasp + 1)));
  addToggle("h", "hand", "Hand");
  addToggle("o", "object", "Object");
  const mapped = data.grasps.some((grasp) => grasp.contact_values);
  if (mapped) addToggle("c", "map", "Contact map");
  byId("scale").hidden = !mapped;
  addToggle("p", "points", "Contact points");
  addToggle("g", "grid", "Grid");
  button("views", "View A", "key a", (keys.a = () => lookFrom(0)));
  button("views", "View B", "key b", (keys.b = () => lookFrom(1)));
  byId("hint").textContent = "drag: orbit · shift or right drag: pan · wheel: zoom · ← →: grasps · grid: 10 mm";
  const colors = data.contact_scale.map((rgb) => `rgb(${rgb.join(",")})`);
  byId("scale").children[1].style.background = `linear-gradient(90deg, ${colors.join(",")})`;
}

function setTheme(name) {
  document.documentElement.dataset.theme = name;
  byId("theme").textContent = name === "dark" ? "Light" : "Dark";
  byId("canvas").style.background = "radial-gradient(circle at 50% 42%, var(--sky), var(--ground))";
  readTheme();
}

function start() {
  byId("title").textContent = data.title;
  byId("summary").textContent = data.summary;
  byId("list").append(...data.grasps.map(listEntry));
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  setTheme(dark.matches ? "dark" : "light");
  dark.addEventListener("change", () => setTheme(dark.matches ? "dark" : "light"));
  byId("theme").addEventListener("click", () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));
  buildControls();
  setUp();
  listenToPointers(byId("canvas"));
  // at once, before the browser paints: a picture of the old size would be stretched for a frame
  new ResizeObserver(() => draw()).observe(byId("canvas"));
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  if (data.grasps.length) choose(0);
  else {
    byId("steps").hidden = byId("views").hidden = true;
    say("no grasp found");
    showDetails();
    lookFrom(0);
  }
}

start();
