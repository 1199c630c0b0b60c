// The page of a set of grasps: list, verdicts, joint values.

function currentView() {
  const grasp = data.grasps[state.chosen];
  return grasp ? grasp.view : data.view;
}

function loadGrasp() {
  const grasp = data.grasps[state.chosen];
  if (!gl || !grasp) return;
  poses = array(grasp.link_poses);
  state.mapped = Boolean(grasp.contact_values);
  if (state.mapped) {
    gl.bindBuffer(gl.ARRAY_BUFFER, scene.object.values);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, array(grasp.contact_values));
  }
  showDots(array(grasp.touching));
}

const largest = (values) => (values.includes(null) || !values.length ? null : Math.max(...values));

function chip(grasp) {
  if (!grasp.verdict) return make("span", "not simulated", "chip unknown");
  return grasp.verdict.success ? make("span", "pass", "chip pass") : make("span", grasp.verdict.failure || "fail", "chip fail");
}

function verdictParts(verdict) {
  const longest = Math.max(...verdict.displacement_m.map((value) => value || 0), 1e-9);
  const passes = verdict.shift_successes.filter(Boolean).length;
  const ran = verdict.shift_successes.length;
  return [
    make("div", `${verdict.protocol} · ${verdict.engine}${verdict.refined ? " · refined" : ""}`, "faint"),
    facts([
      ["moved, at most", millimetres(largest(verdict.displacement_m))],
      ["without a hand it moves", millimetres(verdict.free_displacement_m, 0)],
      ["drift while closing", millimetres(verdict.drift_m)],
      ["penetration before", `${number(verdict.penetration_start_mm, 2)} mm`],
      ["penetration after settling", `${number(verdict.penetration_end_mm, 2)} mm`],
      ["stability over shifts", `${passes}/${ran}` + (ran < verdict.trials ? ` of ${verdict.trials}` : "")],
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

function showDetails() {
  const grasp = data.grasps[state.chosen], side = byId("side");
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
  state.chosen = (index + data.grasps.length) % data.grasps.length;
  [...byId("list").children].forEach((entry, i) => entry.setAttribute("aria-current", String(i === state.chosen)));
  byId("list").children[state.chosen].scrollIntoView({ block: "nearest", inline: "nearest" });
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

function buildControls() {
  button("steps", "‹ Previous", "key ←", (keys.ArrowLeft = () => choose(state.chosen - 1)));
  button("steps", "Next ›", "key →", (keys.ArrowRight = () => choose(state.chosen + 1)));
  addToggle("h", "hand", "Hand");
  addToggle("o", "object", "Object");
  const mapped = data.grasps.some((grasp) => grasp.contact_values);
  if (mapped) addToggle("c", "map", "Contact map");
  byId("scale").hidden = !mapped;
  addToggle("p", "points", "Contact points");
  addCommonControls("← →: grasps · ");
  const colors = data.contact_scale.map((rgb) => `rgb(${rgb.join(",")})`);
  byId("scale").children[1].style.background = `linear-gradient(90deg, ${colors.join(",")})`;
}

function start() {
  byId("list").append(...data.grasps.map(listEntry));
  buildControls();
  startViewer("grasps");
  if (data.grasps.length) choose(0);
  else {
    byId("steps").hidden = byId("views").hidden = true;
    say("no grasp found");
    showDetails();
    lookFrom(0);
  }
}

start();
