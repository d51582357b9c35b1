// The state of the page (a rig, a pose, a wrench, a policy), and what the kernels say of it.
import { add, cross, dot, norm, rotationMatrix, rotate, scale, space } from "./geometry.js";

const MAX_COMPONENTS = 6, MAX_CABLES = 32, MAX_POSES = 65536, MAX_HALF_SPACES = 4096, MAX_WRENCHES = 64;
const GRAVITY = 9.81; // m/s²
export const SOLVERS = ["newton", "closed-form", "least-sum", "minimax", "safe"];
export const POLICIES = ["force", "tension", "direction"];
export const STATUSES = ["EXACT", "NEAREST", "UNPROVEN", "FAILED"];

// Arrays of the kernels in the order of kernels.cpp, with their sizes.
const ARRAYS = {
  anchors: 3 * MAX_CABLES, attachments: 3 * MAX_CABLES,
  lower: MAX_CABLES, upper: MAX_CABLES, reference: MAX_CABLES, weights: MAX_COMPONENTS,
  rotation: 9, wrench: MAX_COMPONENTS, required: MAX_WRENCHES * MAX_COMPONENTS,
  structure: MAX_COMPONENTS * MAX_CABLES, tensions: MAX_CABLES,
  rendered: MAX_COMPONENTS, separation: MAX_COMPONENTS, residual: 1, scale: 1,
  normals: MAX_HALF_SPACES * MAX_COMPONENTS, offsets: MAX_HALF_SPACES,
  positions: 3 * MAX_POSES, margins: MAX_POSES,
}; // prettier-ignore

/** Kernels as an instance of the WebAssembly module. */
export class Kernels {
  static async load(bytes) {
    const { instance } = await WebAssembly.instantiate(bytes);
    return new Kernels(instance.exports);
  }

  constructor(exports) {
    this.run = exports;
    let address = exports.page_address();
    for (const [name, size] of Object.entries(ARRAYS)) {
      this[name] = new Float64Array(exports.memory.buffer, address, size);
      address += 8 * size;
    }
  }

  /** Write a rig and its orientation. */
  set(state) {
    const { rig } = state;
    const d = rig.dimension;
    rig.modules.forEach((module, i) => {
      this.anchors.set(module.anchor.slice(0, d), d * i);
      this.attachments.set((module.attachment ?? [0, 0, 0]).slice(0, d), d * i);
      this.lower[i] = module.lower;
      this.upper[i] = module.upper;
    });
    this.rotation.set(orientation(state).filter((_, i) => d === 3 || (i % 3 < 2 && i < 5)));
    this.run.set_rig(components(rig), d, rig.modules.length);
  }
}

/** Number of components of a wrench. */
export const components = (rig) => (rig.turns ? 3 * (rig.dimension - 1) : rig.dimension);

/** Rotation matrix of the platform in space, row by row. */
export const orientation = ({ rig, rotation }) => rotationMatrix(rig.dimension === 3 ? rotation : [0, 0, rotation[0]]);

/** Wrench in the middle of what the rig requires, with the weight of the platform as it is turned now. */
export function requiredMiddle(state) {
  const { rig } = state;
  const middle = [...rig.required];
  if (!rig.weighs) return middle;
  const lift = scale(rig.up, rig.mass * GRAVITY);
  lift.slice(0, rig.dimension).forEach((x, i) => (middle[i] += x));
  if (!rig.turns || !rig.com) return middle;
  const torque = cross(rotate(orientation(state), space(rig.com)), lift);
  return add(middle, rig.dimension === 3 ? [0, 0, 0, ...torque] : [0, 0, torque[2]]);
}

/** Tensions, status and proof at a state. Status null: a cable has no length. */
export function solve(kernels, state) {
  const { rig } = state;
  const n = components(rig), m = rig.modules.length;
  const middle = requiredMiddle(state);
  kernels.set(state);
  kernels.positions.set(state.position.slice(0, rig.dimension));
  kernels.wrench.set(add(state.wrench, middle));
  const index = kernels.run.allocate(SOLVERS.indexOf(state.solver), POLICIES.indexOf(state.policy));
  return {
    status: STATUSES[index] ?? null,
    tensions: [...kernels.tensions.subarray(0, m)],
    rendered: add([...kernels.rendered.subarray(0, n)], scale(middle, -1)),
    residual: kernels.residual[0],
    structure: [...kernels.structure.subarray(0, n * m)],
    separation: index === 1 ? [...kernels.separation.subarray(0, n)] : null,
  };
}

/** Largest `direction · wrench` over all wrenches that the limits allow, less that of the required wrench. */
export function support(state, structure, direction) {
  const m = state.rig.modules.length;
  const pull = state.rig.modules.map((_, i) => direction.reduce((sum, x, k) => sum + x * structure[k * m + i], 0));
  const most = state.rig.modules.reduce((sum, { lower, upper }, i) => sum + pull[i] * (pull[i] > 0 ? upper : lower), 0);
  return most - dot(direction, requiredMiddle(state));
}

/** Answers at positions on a line through the hand, which reaches as far on both sides. */
export function profile(kernels, state, direction, reach, count) {
  const along = Array.from({ length: count }, (_, i) => reach * ((2 * i) / (count - 1) - 1));
  return along.map((s) => solve(kernels, { ...state, position: add(state.position, scale(direction, s)) }));
}

/**
 * Half-spaces of the forces that the cables can exert beside the required wrench, at the pose of the last `solve`; with
 * the desired torque, where there are torques.
 */
export function forceHalfSpaces(kernels, state) {
  const d = state.rig.dimension, n = components(state.rig);
  const fixed = add(state.wrench.map((x, i) => (i < d ? 0 : x)), requiredMiddle(state));
  const found = [];
  const count = kernels.run.find_half_spaces();
  for (let i = 0; i < count; i++) {
    const normal = [...kernels.normals.subarray(n * i, n * i + n)];
    const force = normal.slice(0, d), length = norm(force);
    const offset = kernels.offsets[i] - dot(normal, fixed);
    if (length > 1e-9) found.push({ normal: scale(force, 1 / length), offset: offset / length });
  }
  return found;
}

/** Capacity margins in N at positions, in their order, about the required wrench. */
export function margins(kernels, state, positions) {
  const d = state.rig.dimension;
  kernels.set(state);
  positions.forEach((position, i) => {
    for (let axis = 0; axis < d; axis++) kernels.positions[d * i + axis] = position[axis];
  });
  kernels.required.set(requiredMiddle(state));
  kernels.run.find_margins(positions.length, 1, state.rig.length);
  return kernels.margins.slice(0, positions.length);
}

/** Grid of margins over the box of the anchors, with about as many points as given. */
export function marginGrid(kernels, state, points) {
  const { rig } = state;
  const axes = [0, 1, 2].slice(0, rig.dimension);
  const low = axes.map((axis) => Math.min(...rig.modules.map(({ anchor }) => anchor[axis])));
  const high = axes.map((axis) => Math.max(...rig.modules.map(({ anchor }) => anchor[axis])));
  const longest = Math.max(...axes.map((axis) => high[axis] - low[axis])) || 1;
  axes.forEach((axis) => { // a flat set of anchors has a workspace on both sides
    const missing = 0.6 * longest - (high[axis] - low[axis]);
    if (missing > 0) [low[axis], high[axis]] = [low[axis] - missing / 2, high[axis] + missing / 2];
  }); // prettier-ignore
  const volume = axes.reduce((product, axis) => product * (high[axis] - low[axis]), 1);
  const spacing = (volume / points) ** (1 / rig.dimension);
  const counts = axes.map((axis) => Math.max(4, Math.min(40, 1 + Math.round((high[axis] - low[axis]) / spacing))));
  const step = axes.map((axis) => (high[axis] - low[axis]) / (counts[axis] - 1));
  const positions = [];
  for (let z = 0; z < (counts[2] ?? 1); z++) {
    for (let y = 0; y < counts[1]; y++) {
      for (let x = 0; x < counts[0]; x++) {
        positions.push(axes.map((axis) => low[axis] + step[axis] * [x, y, z][axis]));
      }
    }
  }
  const values = margins(kernels, state, positions);
  const edge = (i) => { // the surface is closed at the sides of the box
    const index = [i % counts[0], Math.floor(i / counts[0]) % counts[1], Math.floor(i / (counts[0] * counts[1]))];
    return counts.some((count, axis) => index[axis] === 0 || index[axis] === count - 1);
  }; // prettier-ignore
  if (rig.dimension === 3) values.forEach((value, i) => (values[i] = edge(i) ? -Math.abs(value) : value));
  return { counts, origin: low, step, values };
}
