// The page: keeps the state, asks the kernels whenever it changes, and answers pointer and keys.
import { add, areaCells, dot, norm, polytopeFaces, polytopePolygon, scale, space, square, subtract, surfaceNet, unit } from "./geometry.js";
import { Panel, explain } from "./panel.js";
import { Kernels, components, forceHalfSpaces, marginGrid, margins, profile, solve, support } from "./rig.js";
import { Camera, Painter, extent } from "./scene.js";
import { fromHash, toHash, toPython, toRigFile } from "./share.js";

const REACH = { mouse: 18, touch: 30 }; // pixels about a handle that take hold of it
const MOVING_MS = 25, RESTING_MS = 400; // time for the workspace while something moves, and after
const POINTS = [1000, 20000]; // least and most of the workspace
const SETTLES_MS = 180;
const SOLVES = 161; // on the line through the hand

const THEMES = {
  light: {
    background: "#ffffff", text: "#1d2430", line: "#a9b2bf", floor: "#e7eaef", low: [0, 114, 178],
    middle: [168, 168, 168], high: [213, 94, 0], desired: "#b07900", rendered: "#0072b2", hand: "#1d2430",
    workspace: [0, 158, 115], workspaceFlat: "rgba(0, 158, 115, 0.22)", polytope: "rgba(0, 114, 178, 0.45)",
    polytopeFill: "rgba(0, 114, 178, 0.07)", plane: "rgba(213, 94, 0, 0.8)", planeFill: "rgba(213, 94, 0, 0.12)",
  },
  dark: {
    background: "#10151f", text: "#e8ecf3", line: "#5a6578", floor: "#222c3f", low: [86, 180, 233],
    middle: [190, 190, 190], high: [255, 140, 66], desired: "#f0a500", rendered: "#56b4e9", hand: "#ffffff",
    workspace: [46, 204, 155], workspaceFlat: "rgba(46, 204, 155, 0.2)", polytope: "rgba(86, 180, 233, 0.5)",
    polytopeFill: "rgba(86, 180, 233, 0.08)", plane: "rgba(255, 140, 66, 0.8)", planeFill: "rgba(255, 140, 66, 0.14)",
  },
}; // prettier-ignore

class App {
  constructor(kernels, rigs) {
    Object.assign(this, { kernels, rigs, pointers: new Map(), selected: null, largestMargin: 1, pointMs: 0.01 });
    this.canvas = document.getElementById("scene");
    const { state, show } = fromHash(location.hash, rigs, (name) => this.fresh(name));
    this.show = show;
    document.body.classList.toggle("embed", show.embed);
    this.setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
    this.panel = new Panel(this, rigs);
    this.enter(state);
    this.listen();
  }

  /** State of a committed rig: at home, with half of the largest force in a direction that points up and aside. */
  fresh(name = "seven-modules") {
    const rig = structuredClone(this.rigs[name]);
    const state = { rig, position: [...rig.home], rotation: [...rig.homeRotation], policy: "force", solver: "newton" };
    state.wrench = new Array(components(rig)).fill(0);
    solve(this.kernels, state);
    const direction = unit(add([0.6, 0.3, 0.4], rig.up).slice(0, rig.dimension));
    const reaches = forceHalfSpaces(this.kernels, state)
      .map(({ normal, offset }) => offset / dot(normal, direction))
      .filter((reach) => reach > 0 && Number.isFinite(reach));
    const half = reaches.length ? Math.min(...reaches) / 2 : 0;
    direction.forEach((x, i) => (state.wrench[i] = +(half * x).toPrecision(3)));
    return state;
  }

  /** Show another state. */
  enter(state) {
    const { rig } = (this.state = state);
    this.selected = null;
    this.along = [1, 0, 0].slice(0, rig.dimension);
    this.size = extent(rig);
    this.camera = new Camera(this.size.centre, 2.8 * this.size.radius, space(rig.up), rig.dimension === 2);
    this.painter = new Painter(this.canvas, this.camera, this.theme);
    solve(this.kernels, this.state);
    const halfSpaces = forceHalfSpaces(this.kernels, state);
    const offsets = halfSpaces.map(({ offset }) => Math.abs(offset)).sort((a, b) => a - b);
    const largest = Math.max(...rig.modules.map(({ upper }) => upper));
    this.metresPerNewton = (0.5 * this.size.radius) / (offsets[offsets.length >> 1] || largest || 1);
    this.panel.build();
    this.resize();
  }

  /** Use the light theme, or the dark one. */
  setTheme(name) {
    document.documentElement.dataset.theme = name;
    this.theme = THEMES[name];
    if (!this.painter) return;
    this.painter.theme = this.theme;
    this.refresh();
  }

  // Changes of the state.

  change(parts) {
    Object.assign(this.state, parts);
    this.refresh();
  }

  setNumber(key, i, value) {
    this.change({ [key]: this.state[key].map((x, j) => (i === j ? value : x)) });
  }

  setLimit(i, key, value) {
    const module = { ...this.state.rig.modules[i], [key]: value };
    if (module.lower < 0 || module.lower > module.upper) return;
    this.state.rig.modules[i] = module;
    this.edited();
  }

  edited() {
    this.state.rig.edited = true;
    this.refresh();
  }

  addModule() {
    const { rig } = this.state;
    if (rig.modules.length === 32) return;
    const [last] = rig.modules.slice(-1);
    const names = new Set(rig.modules.map(({ name }) => name));
    let number = rig.modules.length + 1;
    while (names.has(`module-${number}`)) number++;
    const centre = this.size.centre.slice(0, rig.dimension);
    const mirrored = last.anchor.map((x, i) => +(2 * centre[i] - x + 0.1 * this.size.radius).toFixed(3));
    rig.modules.push({ ...structuredClone(last), name: `module-${number}`, anchor: mirrored });
    this.panel.build();
    this.selected = rig.modules.length - 1;
    this.edited();
  }

  removeModule(i) {
    if (this.state.rig.modules.length === 1) return;
    this.state.rig.modules.splice(i, 1);
    this.selected = null;
    this.panel.build();
    this.edited();
  }

  toggle(name, value) {
    this.show[name] = value;
    this.refresh();
  }

  select(handle) {
    this.selected = handle;
    this.refresh();
  }

  // What is computed and drawn.

  /** Compute and draw with the next frame; the workspace in detail once nothing has changed for a moment. */
  refresh() {
    clearTimeout(this.settling);
    this.settling = setTimeout(() => this.update(RESTING_MS), SETTLES_MS);
    this.frame ??= requestAnimationFrame(() => this.update(MOVING_MS));
  }

  update(budget) {
    this.frame = null;
    const { state, kernels } = this;
    if (this.show.profile || budget === RESTING_MS) {
      const begin = performance.now(), reach = 0.4 * this.size.radius;
      this.profile = { reach, answers: profile(kernels, state, this.along, reach, SOLVES) };
      const microseconds = (1000 * (performance.now() - begin)) / SOLVES;
      this.speed = `${microseconds.toFixed(1)} µs an answer, proof included, computed in this page.`;
    }
    this.answer = solve(kernels, state);
    const view = { ...this.view(budget), state, answer: this.answer, selected: this.selected };
    this.painter.draw({ ...view, floor: this.size.floor });
    const [margin] = margins(kernels, state, [state.position]);
    this.panel.update({ margin, reason: explain(this), speed: this.speed ?? "" });
    const hash = toHash(state, this.show);
    if (budget === RESTING_MS && !this.show.embed && hash !== location.hash) history.replaceState(null, "", hash);
  }

  /** Shapes beside the rig: arrows, polytope, separating plane, workspace. */
  view(budget) {
    const { state, answer, kernels, show } = this;
    const d = state.rig.dimension;
    const pose = space(state.position);
    const place = (force) => add(pose, scale(space(force), this.metresPerNewton));
    const view = { arrows: { desired: place(state.wrench.slice(0, d)), rendered: place(answer.rendered.slice(0, d)) } };
    if (answer.status === null) return view;
    if (show.profile) view.profile = this.profile;
    if (show.polytope) {
      const halfSpaces = forceHalfSpaces(kernels, state);
      const placed = ({ normal, polygon }) => ({ normal, polygon: polygon.map(place) });
      if (d === 3) view.polytope = { faces: polytopeFaces(halfSpaces).map(placed) };
      else view.polytope = { polygon: polytopePolygon(halfSpaces).map(place) };
    }
    if (answer.separation) view.plane = this.plane(place);
    if (show.workspace) view.workspace = this.workspace(budget);
    return view;
  }

  /** Plane (a line in the plane) in the space of forces, with the desired torque, behind which none can be rendered. */
  plane(place) {
    const { state, answer } = this;
    const d = state.rig.dimension;
    const force = answer.separation.slice(0, d), length = norm(force);
    if (length < 1e-9) return null;
    const normal = scale(force, 1 / length);
    const torque = dot(answer.separation.slice(d), state.wrench.slice(d));
    const offset = (support(state, answer.structure, answer.separation) - torque) / length;
    const desired = state.wrench.slice(0, d);
    const through = place(add(desired, scale(normal, offset - dot(normal, desired))));
    if (d === 3) return square(normal, through, 0.4 * this.size.radius);
    const along = scale([-normal[1], normal[0], 0], 0.4 * this.size.radius);
    return [add(through, along), subtract(through, along)];
  }

  workspace(budget) {
    const key = JSON.stringify([this.state.rig, this.state.rotation, budget]);
    if (this.gridKey !== key) {
      const points = Math.max(POINTS[0], Math.min(POINTS[1], budget / this.pointMs));
      const begin = performance.now();
      this.grid = marginGrid(this.kernels, this.state, points);
      this.pointMs = (performance.now() - begin) / this.grid.values.length;
      this.gridKey = key;
      this.largestMargin = Math.max(...this.grid.values);
    }
    const grid = { ...this.grid, values: this.grid.values.map((value) => value - this.show.level) };
    return grid.counts.length === 3 ? { quads: surfaceNet(grid) } : { polygons: areaCells(grid) };
  }

  resize() {
    const pixels = devicePixelRatio || 1;
    Object.assign(this.canvas, { width: innerWidth * pixels, height: innerHeight * pixels });
    const { offsetWidth, offsetHeight } = document.getElementById("panel");
    const below = offsetWidth > 0.9 * innerWidth; // on a phone and in a scene of the documentation
    const width = innerWidth - (below ? 0 : offsetWidth), height = innerHeight - (below ? offsetHeight : 0);
    this.camera.resize(width, height, width / 2, height / 2);
    this.refresh();
  }

  // Pointer and keys.

  /** Handles by name, with their places in space. */
  handles() {
    const { rig, position, wrench } = this.state;
    const pose = space(position);
    const tip = add(pose, scale(space(wrench.slice(0, rig.dimension)), this.metresPerNewton));
    return [["force", tip], ["hand", pose], ...rig.modules.map(({ anchor }, i) => [i, space(anchor)])];
  }

  /** Handle within reach of a place on the canvas, the force before the hand before the modules. */
  handleAt(x, y, reach) {
    const distance = (point) => {
      const at = this.camera.project(point);
      return Math.hypot(at.x - x, at.y - y);
    };
    const near = this.handles().map(([name, point]) => ({ name, away: distance(point) }));
    const closest = near.reduce((best, handle) => (handle.away < best.away - 1e-9 ? handle : best));
    return closest.away <= reach ? closest.name : null;
  }

  /** Move a handle in space. */
  move(handle, movement) {
    const { rig, position, wrench } = this.state;
    const d = rig.dimension;
    const shift = (values, by, digits) => values.map((x, i) => (i < d ? +(x + by[i]).toFixed(digits) : x));
    const digits = Math.max(0, 4 - Math.floor(Math.log10(this.size.radius)));
    if (handle === "force") {
      const newtons = scale(movement, 1 / this.metresPerNewton);
      const fine = Math.max(0, 4 + Math.floor(Math.log10(this.metresPerNewton / this.size.radius)));
      this.change({ wrench: shift(wrench, newtons, Math.min(6, fine)) });
    } else if (handle === "hand") {
      if (norm(movement) > 0) this.along = unit(movement.slice(0, d));
      this.change({ position: shift(position, movement, digits) });
    } else {
      rig.modules[handle] = { ...rig.modules[handle], anchor: shift(rig.modules[handle].anchor, movement, digits) };
      this.edited();
    }
  }

  turn(dx, dy) {
    const { camera } = this;
    if (camera.planar) {
      camera.target = subtract(camera.target, camera.movement(camera.target, dx, dy));
    } else {
      camera.yaw -= 0.008 * dx;
      camera.pitch = Math.max(-1.5, Math.min(1.5, camera.pitch + 0.008 * dy));
    }
    this.refresh();
  }

  zoom(factor) {
    const { camera, size } = this;
    camera.distance = Math.max(0.5 * size.radius, Math.min(20 * size.radius, camera.distance * factor));
    this.refresh();
  }

  listen() {
    const { canvas, pointers } = this;
    addEventListener("resize", () => this.resize());
    addEventListener("hashchange", () => {
      const { state, show } = fromHash(location.hash, this.rigs, (name) => this.fresh(name));
      this.show = show;
      this.enter(state);
    });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      const reach = REACH[event.pointerType] ?? REACH.mouse;
      this.held = pointers.size === 1 ? this.handleAt(event.clientX, event.clientY, reach) : null;
      if (this.held !== null) this.select(this.held);
    });
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    for (const name of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
    }
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(0.0012 * event.deltaY));
    }, { passive: false }); // prettier-ignore
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  drag(event) {
    const { pointers } = this;
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [dx, dy] = subtract(now, before);
    if (pointers.size === 2) {
      const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      this.zoom(norm(subtract(before, other)) / Math.max(norm(subtract(now, other)), 1));
    } else if (this.held === null) {
      this.turn(dx, dy);
    } else {
      const [, point] = this.handles().find(([name]) => name === this.held);
      this.move(this.held, this.camera.movement(point, dx, dy));
    }
    pointers.set(event.pointerId, now);
  }

  key(event) {
    const names = this.handles().map(([name]) => name);
    const step = 0.02 * this.size.radius;
    const { right, upward, inward } = this.camera.basis;
    const moves = {
      ArrowRight: right, ArrowLeft: scale(right, -1), ArrowUp: upward, ArrowDown: scale(upward, -1),
      PageUp: inward, PageDown: scale(inward, -1),
    }; // prettier-ignore
    if (event.key in moves) this.move(this.selected ?? "force", scale(moves[event.key], step));
    else if (event.key === "n" || event.key === "p") {
      const next = names.indexOf(this.selected) + (event.key === "n" ? 1 : -1);
      this.select(names[(next + names.length) % names.length]);
    } else if (event.key === "+") this.addModule();
    else if (event.key === "Delete" && typeof this.selected === "number") this.removeModule(this.selected);
    else return;
    event.preventDefault();
  }
}

/** Bytes of a text in base64 that were packed by gzip. */
async function unpack(text) {
  const packed = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

const kernels = await Kernels.load(await unpack(document.getElementById("kernels").textContent));
const rigs = JSON.parse(document.getElementById("rigs").textContent);
const app = new App(kernels, rigs);
// What a test or a scene in the documentation asks of the page.
globalThis.tensionlab = { app, kernels, solve, margins, toRigFile, toPython };
