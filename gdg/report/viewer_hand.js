// The page of one hand: postures, joints to move, contact regions, what was decided and found.

const values = data.joints.map((joint) => joint.open);
const sliders = [];
let closing = null;

const currentView = () => data.view;

function pose() {
  const links = linkPoses(data.tree, values);
  poses = new Float32Array(16 * data.link_meshes.length);
  data.link_meshes.forEach((mesh, i) => poses.set(links[mesh.link], 16 * i));
  redraw();
}

const shown = (joint, value) => (joint.unit === "m" ? millimetres(value) : degrees(value));

function setJoint(index, value) {
  values[index] = value;
  sliders[index].input.value = value;
  sliders[index].text.textContent = shown(data.joints[index], value);
}

function setPosture(of) {
  data.joints.forEach((joint, i) => setJoint(i, of(joint)));
  pose();
}

const between = (share) => (joint) => joint.open + share * (joint.closed - joint.open);

function slider(low, high, value, label, act) {
  const input = make("input");
  Object.assign(input, { type: "range", min: low, max: high, step: "any", value });
  input.setAttribute("aria-label", label);
  input.addEventListener("input", () => act(Number(input.value)));
  return input;
}

function buildPostures() {
  const add = (text, key, act) => {
    const made = make("button", text, "", make("span", `key ${key}`, "note"));
    made.type = "button";
    made.addEventListener("click", (keys[key] = act));
    byId("list").append(made);
  };
  const close = (share) => { closing.value = share; setPosture(between(share)); };
  byId("list").append(make("h2", "Postures"));
  add("Open", "1", () => close(0));
  add("Closed", "2", () => close(1));
  add("Middle of all ranges", "3", () => setPosture((joint) => (joint.lower + joint.upper) / 2));
  closing = slider(0, 1, 0, "closing", (share) => setPosture(between(share)));
  byId("list").append(make("label", "open to closed", "slide", closing), make("h2", "Colours"));
  for (const entry of data.legend) {
    const swatch = make("i");
    swatch.style.background = `rgb(${entry.color.join(",")})`;
    byId("list").append(make("div", "", "swatch", swatch, make("span", entry.text)));
  }
}

// -- what stands beside the view ------------------------------------------------------------------

const LEVELS = { error: "fail", warning: "doubt", sure: "pass", likely: "unknown", "look at this": "fail" };

function card(level, heading, value, text) {
  const made = make("div", "", "card", make("div", "", "heading", make("span", heading), make("span", level, `chip ${LEVELS[level]}`)));
  if (value) made.append(make("div", value, "value"));
  if (text) made.append(make("div", text, "faint"));
  return made;
}

function section(title, entries) {
  if (entries.length) byId("side").append(make("h2", `${title} (${entries.length})`), ...entries);
}

function jointEntry(joint, index) {
  const text = make("output");
  const input = slider(joint.lower, joint.upper, joint.open, joint.name, (value) => { setJoint(index, value); pose(); });
  sliders.push({ input, text });
  const about = [
    joint.type, `${shown(joint, joint.lower)} to ${shown(joint, joint.upper)}`,
    `open ${shown(joint, joint.open)}, closed ${shown(joint, joint.closed)}`, joint.drive,
  ].join(" · ");
  return make("div", "", "joint", make("div", "", "heading", make("span", joint.name), text), input, make("div", about, "faint"));
}

function buildSide() {
  section("Found", data.findings.map((finding) => card(finding.severity, finding.place, "", finding.text)));
  section("Decided", data.decisions.map((decision) =>
    card(decision.verdict, decision.subject, decision.value, `${decision.reason} (${Math.round(100 * decision.confidence)} % sure)`)));
  section("Repaired", data.repairs.map((text) => make("div", text, "card")));
  section("Joints", data.joints.map(jointEntry));
  section("Joints that follow", data.followers.map((text) => make("div", text, "faint")));
  byId("side").append(make("h2", "Contact regions"), table(["link", "regions", "area"], data.regions));
  byId("side").append(make("h2", "About"), facts(data.facts));
}

function start() {
  document.body.classList.add("wide");
  byId("scale").hidden = byId("steps").hidden = true;
  buildPostures();
  buildSide();
  addToggle("h", "hand", "Hand");
  addToggle("r", "region", "Contact regions");
  addToggle("p", "palm", "Palm normal");
  addToggle("f", "root", "Root frame");
  addCommonControls("");
  startViewer("postures");
  setPosture(between(0));
  lookFrom(0);
}

start();
