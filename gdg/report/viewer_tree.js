// Where the links of a hand are for given joint values; matrices are column-major.

function motion(joint, value) {
  const [x, y, z] = joint.axis;
  if (joint.kind === "slide")
    return new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x * value, y * value, z * value, 1]);
  if (joint.kind === "fixed") return IDENTITY;
  const c = Math.cos(value), s = Math.sin(value), t = 1 - c;
  return new Float32Array([
    t * x * x + c, t * x * y + s * z, t * x * z - s * y, 0,
    t * x * y - s * z, t * y * y + c, t * y * z + s * x, 0,
    t * x * z + s * y, t * y * z - s * x, t * z * z + c, 0,
    0, 0, 0, 1,
  ]);
}

// Mimic joints follow: each joint's value is offset + Σ factor · value of an actuated joint.
function linkPoses(tree, values) {
  const found = [];
  found[tree.root] = new Float32Array(tree.root_pose);
  for (const joint of tree.joints) {
    const value = joint.factors.reduce((sum, [index, factor]) => sum + factor * values[index], joint.offset);
    found[joint.child] = multiply(multiply(found[joint.parent], new Float32Array(joint.pose)), motion(joint, value));
  }
  return found;
}
