// What the page draws: the rig, its tensions, the force polytope, the separating plane and the workspace, in
// perspective on a plain canvas.
import { add, cross, dot, norm, rotate, scale, space, subtract, unit } from "./geometry.js";
import { orientation } from "./rig.js";

const FIELD_OF_VIEW = 0.7; // rad, of the shorter side
export const HANDLE_RADIUS = 7;

/** Camera that turns about a point; `up` is a unit vector. Planar rigs are seen from the front. */
export class Camera {
  constructor(target, distance, up, planar) {
    Object.assign(this, { target, distance, up, planar });
    this.yaw = planar ? 0 : 0.6;
    this.pitch = planar ? 0 : 0.35;
    this.resize(1, 1, 0, 0);
  }

  /** Set the size of the canvas, and the middle of what is free of panels. */
  resize(width, height, x, y) {
    Object.assign(this, { width, height, x, y });
    this.focal = (0.5 * Math.min(width, height)) / Math.tan(FIELD_OF_VIEW / 2);
  }

  /** Unit vectors to the right, up and into the picture. */
  get basis() {
    const [east, north] = this.planar ? [[1, 0, 0], [0, 0, 1]] : horizontal(this.up);
    const level = add(scale(east, Math.sin(this.yaw)), scale(north, -Math.cos(this.yaw)));
    const inward = this.planar
      ? [0, 0, -1]
      : add(scale(level, Math.cos(this.pitch)), scale(this.up, -Math.sin(this.pitch)));
    const right = unit(cross(inward, this.planar ? [0, 1, 0] : this.up));
    return { right, upward: cross(right, inward), inward };
  }

  /** Place of a point on the canvas: x, y, depth in m, and pixels per metre there. */
  project(point) {
    const { right, upward, inward } = this.basis;
    const from = subtract(space(point), this.target);
    const depth = Math.max(this.distance + dot(inward, from), 0.02 * this.distance);
    const pixels = this.focal / depth;
    return { x: this.x + pixels * dot(right, from), y: this.y - pixels * dot(upward, from), depth, pixels };
  }

  /** Movement in space of a point that moves by pixels on the canvas, in the plane of the picture. */
  movement(point, dx, dy) {
    const { right, upward } = this.basis;
    const { pixels } = this.project(point);
    return add(scale(right, dx / pixels), scale(upward, -dy / pixels));
  }
}

/** Two horizontal unit vectors, in a right-handed system with the upward one. */
function horizontal(up) {
  const east = Math.abs(up[0]) < 0.5 ? [1, 0, 0] : [0, 1, 0];
  return [east, cross(up, east)];
}

/** Colour of a tension between its limits: blue, neutral, orange. */
export function tensionColour(theme, share) {
  const [from, to] = share < 0.5 ? [theme.low, theme.middle] : [theme.middle, theme.high];
  const part = share < 0.5 ? 2 * share : 2 * share - 1;
  return `rgb(${from.map((x, i) => Math.round(x + (to[i] - x) * Math.min(1, Math.max(0, part))))})`;
}

/** Attachments of the cables in space. */
export function attachments(state) {
  const pose = space(state.position), turned = orientation(state);
  return state.rig.modules.map(({ attachment }) =>
    state.rig.turns && attachment ? add(pose, rotate(turned, space(attachment))) : pose,
  );
}

/** Draws one picture after the other. */
export class Painter {
  constructor(canvas, camera, theme) {
    Object.assign(this, { canvas, camera, theme, context: canvas.getContext("2d") });
  }

  /** Draw a path on the canvas that `trace` makes. */
  shape(trace, fill, stroke, width) {
    const { context } = this;
    Object.assign(context, { fillStyle: fill, strokeStyle: stroke, lineWidth: width });
    context.beginPath();
    trace(context);
    if (fill) context.fill();
    if (stroke) context.stroke();
  }

  line(points, colour, width) {
    const places = points.map((point) => this.camera.project(point));
    this.shape((path) => places.forEach(({ x, y }) => path.lineTo(x, y)), null, colour, width);
  }

  polygon(points, fill, stroke) {
    const places = points.map((point) => this.camera.project(point));
    const ring = (path) => {
      places.forEach(({ x, y }) => path.lineTo(x, y));
      path.closePath();
    };
    this.shape(ring, fill, stroke, 1);
  }

  disc(point, radius, fill, stroke) {
    const { x, y } = this.camera.project(point);
    this.shape((path) => path.arc(x, y, radius, 0, 2 * Math.PI), fill, stroke, 2);
  }

  /** Write beside a point, unless something is written there already. */
  label(point, text, dx, dy) {
    const { x, y } = this.camera.project(point);
    if (this.labels.some((other) => Math.abs(other.x - x) < 6.5 * text.length && Math.abs(other.y - y) < 14)) return;
    this.labels.push({ x, y });
    this.text(text, x + dx, y + dy);
  }

  text(text, x, y) {
    const { context, theme } = this;
    Object.assign(context, { font: "12px system-ui, sans-serif", lineWidth: 3, strokeStyle: theme.background });
    Object.assign(context, { lineJoin: "round", fillStyle: theme.text });
    context.strokeText(text, x, y);
    context.fillText(text, x, y);
  }

  arrow(from, to, colour, width) {
    const a = this.camera.project(from), b = this.camera.project(to);
    const length = Math.hypot(b.x - a.x, b.y - a.y);
    if (length < 1) return;
    const [ux, uy] = [(b.x - a.x) / length, (b.y - a.y) / length];
    const head = Math.min(4 * width, length);
    const back = (along, aside) => [b.x - head * (along * ux + aside * uy), b.y - head * (along * uy - aside * ux)];
    const through = (...places) => (path) => places.forEach(([x, y]) => path.lineTo(x, y));
    this.shape(through([a.x, a.y], back(0.8, 0)), null, colour, width);
    this.shape(through([b.x, b.y], back(1, 0.5), back(1, -0.5)), colour);
  }

  /** Draw a state with its answer, and what was computed beside it. */
  draw(view) {
    const { context, canvas, theme } = this;
    const pixels = globalThis.devicePixelRatio || 1;
    this.labels = [];
    context.setTransform(pixels, 0, 0, pixels, 0, 0);
    context.fillStyle = theme.background;
    context.fillRect(0, 0, canvas.width / pixels, canvas.height / pixels);
    if (!this.camera.planar) this.floor(view);
    if (view.workspace) this.workspace(view.workspace);
    if (view.polytope) this.polytope(view.polytope);
    if (view.plane) this.polygon(view.plane, theme.planeFill, theme.plane);
    this.rig(view);
    this.forces(view);
    if (view.profile) this.profile(view);
  }

  floor({ floor: { centre, half, step } }) {
    const [east, north] = horizontal(this.camera.up);
    for (let x = -half; x <= half + 1e-9; x += step) {
      for (const [a, b] of [[east, north], [north, east]]) {
        const middle = add(centre, scale(a, x));
        this.line([add(middle, scale(b, -half)), add(middle, scale(b, half))], this.theme.floor, 1);
      }
    }
  }

  workspace({ quads, polygons }) {
    const { theme, camera } = this;
    if (polygons) return polygons.forEach((polygon) => this.polygon(polygon, theme.workspaceFlat));
    const { right, upward, inward } = camera.basis;
    const light = unit(add(add(scale(right, -0.4), scale(upward, 0.7)), scale(inward, -0.6)));
    const ordered = quads.map((quad) => ({ quad, depth: dot(inward, quad[0]) + dot(inward, quad[2]) }));
    ordered.sort((a, b) => b.depth - a.depth);
    for (const { quad } of ordered) {
      const normal = unit(cross(subtract(quad[2], quad[0]), subtract(quad[3], quad[1])));
      const brightness = 0.55 + 0.45 * Math.abs(dot(normal, light));
      const [r, g, b] = theme.workspace.map((x) => Math.round(x * brightness));
      this.polygon(quad, `rgba(${r}, ${g}, ${b}, 0.3)`);
    }
  }

  polytope({ faces, polygon }) {
    const { theme, camera } = this;
    if (polygon) return this.polygon(polygon, theme.polytopeFill, theme.polytope);
    const { inward } = camera.basis;
    const ordered = [...faces].sort((a, b) => dot(inward, b.normal) - dot(inward, a.normal));
    for (const face of ordered) this.polygon(face.polygon, theme.polytopeFill, theme.polytope);
  }

  rig({ state, answer, selected }) {
    const { theme } = this;
    const { rig } = state;
    const ends = attachments(state);
    const pose = space(state.position);
    rig.modules.forEach((module, i) => {
      const anchor = space(module.anchor);
      const share = (answer.tensions[i] - module.lower) / (module.upper - module.lower || 1);
      const known = answer.status !== null && answer.status !== "FAILED";
      const colour = known ? tensionColour(theme, share) : theme.line;
      this.line([ends[i], anchor], colour, 1.5 + (known ? 3 * Math.min(1, Math.max(0, share)) : 0));
      if (rig.turns) this.line([pose, ends[i]], theme.text, 1);
      this.disc(anchor, HANDLE_RADIUS, theme.text, selected === i ? theme.desired : null);
      this.label(anchor, known ? `${module.name} ${format(answer.tensions[i])} N` : module.name, 11, 4);
    });
  }

  /** Chart of the tensions on a line through the hand; shaded where the solver proves nothing. */
  profile({ profile, state, selected }) {
    const { theme, camera } = this;
    const { answers, reach } = profile;
    const width = Math.min(320, 2 * camera.x - 40), height = 110, left = 20, bottom = 2 * camera.y - 20;
    const most = Math.max(...state.rig.modules.map(({ upper }) => upper));
    const across = (i) => left + (width * i) / (answers.length - 1);
    const up = (tension) => bottom - (height * tension) / most;
    this.shape((path) => path.rect(left, up(most), width, height), theme.background);
    const unproved = answers.flatMap(({ status }, i) => (["EXACT", "NEAREST"].includes(status) ? [] : [i]));
    for (const i of unproved) {
      this.shape((path) => path.rect(across(i - 0.5), up(most), across(1) - left, height), theme.planeFill);
    }
    for (const half of [1, 2]) {
      this.shape((path) => path.rect(left, up(most), (width * half) / 2, height), null, theme.line, 1);
    }
    state.rig.modules.forEach((_, k) => {
      const curve = (path) => answers.forEach(({ tensions }, i) => path.lineTo(across(i), up(tensions[k])));
      this.shape(curve, null, selected === k ? theme.desired : theme.rendered, selected === k ? 3 : 1.3);
    });
    this.text(`Tensions to ${format(most)} N, along ${format(2 * reach)} m through the hand`, left, up(most) - 5);
  }

  forces({ state, answer, arrows, selected }) {
    const { theme } = this;
    const pose = space(state.position);
    if (answer.status === "NEAREST") this.arrow(pose, arrows.rendered, theme.rendered, 5);
    this.arrow(pose, arrows.desired, theme.desired, 3.5);
    this.disc(arrows.desired, 5, theme.desired, selected === "force" ? theme.text : null);
    this.disc(pose, HANDLE_RADIUS, theme.hand, selected === "hand" ? theme.desired : theme.background);
  }
}

/** A number in three significant digits, without an exponent. */
export function format(number) {
  const size = Math.abs(number);
  return number.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : 2);
}

/** Middle, edges of the square on the floor beneath a rig, and half the diagonal of its anchors. */
export function extent(rig) {
  const points = [...rig.modules.map(({ anchor }) => space(anchor)), space(rig.home)];
  const low = [0, 1, 2].map((axis) => Math.min(...points.map((point) => point[axis])));
  const high = [0, 1, 2].map((axis) => Math.max(...points.map((point) => point[axis])));
  const centre = scale(add(low, high), 0.5);
  const radius = Math.max(norm(subtract(high, low)) / 2, 1e-3);
  const lowest = Math.min(...points.map((point) => dot(space(rig.up), point)));
  const step = 10 ** Math.floor(Math.log10(radius)) * (radius / 10 ** Math.floor(Math.log10(radius)) > 4 ? 1 : 0.5);
  const below = add(centre, scale(space(rig.up), lowest - dot(space(rig.up), centre)));
  return { centre, radius, floor: { centre: below, half: step * Math.ceil((1.2 * radius) / step), step } };
}
