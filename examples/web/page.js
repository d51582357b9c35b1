// A hand, and a wall, spring, weight or honey that it feels, in a web page: the pointer is the hand.
//
// Sixty times a second the page sends where the hand is, and draws what the bridge answers. Where the bridge goes
// away the page looks for it again; where the page is hidden, it sends nothing, and the bridge lets the force fade.
import { Bridge } from "../bridge/bridge.js";

const url = new URLSearchParams(location.search).get("bridge") ?? "ws://127.0.0.1:8765";
const SPAN = 0.4; // m, from one edge of a view to the other
const ARROW = 0.05; // m of a view for each N
const RETRY = 1000; // ms
const EVENTS = 8; // lines that stay
const byId = (id) => document.getElementById(id);
const KINDS = {
  wall: () => ({ kind: "wall", plane: { point: wall, normal: axes.up }, stiffness: strength() }),
  spring: () => ({ kind: "spring", centre, stiffness: strength() }),
  weight: () => ({ kind: "weight", mass: strength() / 1000 }),
  viscous: () => ({ kind: "viscous", damping: strength() / 50 }),
};
const strength = () => Number(byId("strength").value);

let axes; // unit vectors of the rig: right and up in the front view, ahead into it
let centre, hand, wall; // points in the rig's axes, in m: of the views, of the pointer, one of the wall
let state; // the bridge's latest

const scaled = (vector, factor) => vector.map((x) => x * factor);
const plus = (a, b) => a.map((x, i) => x + b[i]);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);

// The axes of the views, for a rig in two or three dimensions of which one axis points up, as "y" or "-z".
function axesOf(up, dimension) {
  const number = "xyz".indexOf((up ?? "y").slice(-1));
  const unit = (i, sign = 1) => Array.from({ length: dimension }, (_, j) => (i === j ? sign : 0));
  const upward = unit(number, up?.startsWith("-") ? -1 : 1);
  if (dimension === 2) return { right: unit(1 - number), up: upward, ahead: null };
  return { right: unit((number + 2) % 3), up: upward, ahead: unit((number + 1) % 3) };
}

const VIEWS = [
  { canvas: byId("front"), across: () => axes.right },
  { canvas: byId("side"), across: () => axes.ahead },
];

function draw({ canvas, across }) {
  const size = canvas.clientWidth, scale = size / SPAN;
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`);
  canvas.width = canvas.height = size * devicePixelRatio;
  const ink = canvas.getContext("2d");
  ink.scale(devicePixelRatio, devicePixelRatio);
  const at = (point) => {
    const off = plus(point, scaled(centre, -1));
    return [size / 2 + scale * dot(off, across()), size / 2 - scale * dot(off, axes.up)];
  };
  if (byId("kind").value === "wall") {
    const [, y] = at(wall);
    ink.fillStyle = colour("wall");
    ink.fillRect(0, y, size, size);
  }
  if (byId("kind").value === "spring") {
    ink.strokeStyle = colour("faint");
    ink.beginPath();
    ink.moveTo(...at(centre));
    ink.lineTo(...at(state.position));
    ink.stroke();
  }
  const known = ["desired", "measured"].filter((name) => !state[name].includes(null));
  for (const name of known) arrow(ink, at(state.position), at, state[name], colour(name));
  ink.fillStyle = colour("ink");
  ink.beginPath();
  ink.arc(...at(state.position), 6, 0, 2 * Math.PI);
  ink.fill();
}

function arrow(ink, [x, y], at, wrench, colour) {
  const force = wrench.slice(0, state.position.length);
  const [tipX, tipY] = at(plus(state.position, scaled(force, ARROW)));
  const angle = Math.atan2(tipY - y, tipX - x);
  if (Math.hypot(tipX - x, tipY - y) < 2) return;
  ink.strokeStyle = colour;
  ink.lineWidth = 3;
  ink.beginPath();
  ink.moveTo(x, y);
  ink.lineTo(tipX, tipY);
  for (const side of [-2.6, 2.6]) {
    ink.moveTo(tipX, tipY);
    ink.lineTo(tipX + 9 * Math.cos(angle + side), tipY + 9 * Math.sin(angle + side));
  }
  ink.stroke();
}

function show(welcome) {
  VIEWS.filter(({ across }) => across()).forEach(draw);
  for (const name of ["desired", "measured"]) {
    const force = state[name].map((x) => x?.toFixed(2).replace(/^-(0\.00)$/, "$1").padStart(6) ?? "?");
    byId(name).textContent = `${force.join(" ")} N`;
  }
  const rows = welcome.modules.map((name, i) => {
    const row = document.createElement("tr");
    const bar = document.createElement("meter");
    const tension = state.tensions[i]; // null until the module has told it
    Object.assign(bar, { max: welcome.upper[i], value: tension ?? 0 });
    const cells = [name, bar, `${tension?.toFixed(2) ?? "?"} N`].map((content) => {
      const cell = document.createElement("td");
      cell.append(content);
      return cell;
    });
    row.append(...cells);
    return row;
  });
  byId("tensions").replaceChildren(...rows);
}

// What is dragged moves by as much as the pointer: the wall, if that is pressed more than a hand's width below.
function drag({ canvas, across }) {
  let moved = null;
  canvas.onpointerdown = (event) => {
    if (!hand) return;
    const height = (0.5 - event.offsetY / canvas.clientHeight) * SPAN;
    const above = height - dot(plus(wall, scaled(centre, -1)), axes.up);
    const reached = dot(plus(hand, scaled(centre, -1)), axes.up) - height;
    moved = byId("kind").value === "wall" && above < 0 && reached > 0.03 ? "wall" : "hand";
    canvas.setPointerCapture(event.pointerId);
  };
  canvas.onpointermove = (event) => {
    if (!moved) return;
    const meters = SPAN / canvas.clientWidth;
    const upward = scaled(axes.up, -event.movementY * meters);
    if (moved === "wall") wall = plus(wall, upward);
    else hand = plus(hand, plus(upward, scaled(across(), event.movementX * meters)));
  };
  canvas.onpointerup = canvas.onpointercancel = () => (moved = null);
}

function tell(text) {
  const line = document.createElement("li");
  line.textContent = text;
  byId("events").prepend(line);
  while (byId("events").children.length > EVENTS) byId("events").lastChild.remove();
}

// Until the bridge goes, or says no.
async function play(bridge) {
  const welcome = await bridge.welcome;
  byId("rig").textContent = welcome.rig;
  byId("status").textContent = `connected to ${url}`;
  byId("stop").onclick = () => bridge.socket.send(JSON.stringify({ type: "stop" }));
  state = await bridge.frame(performance.now() / 1000, {});
  axes = axesOf(welcome.up, state.position.length);
  byId("side").parentElement.hidden = !axes.ahead;
  centre ??= state.position;
  hand ??= centre;
  wall ??= plus(centre, scaled(axes.up, -0.05));
  for (;;) {
    await new Promise(requestAnimationFrame);
    const felt = KINDS[byId("kind").value]();
    byId("strength-shown").textContent =
      felt.mass ? `${felt.mass} kg` : felt.damping ? `${felt.damping} N s/m` : `${felt.stiffness} N/m`;
    state = await bridge.frame(performance.now() / 1000, { hand: { position: hand } }, { felt });
    show(welcome);
  }
}

for (const kind of Object.keys(KINDS)) byId("kind").add(new Option(kind));
VIEWS.forEach(drag);
for (;;) {
  const bridge = new Bridge(url, (event) => tell(event.text));
  try {
    await play(bridge);
  } catch (error) {
    byId("status").textContent = `${error.message}; trying again`;
    bridge.close();
    await new Promise((resolve) => setTimeout(resolve, RETRY));
  }
}
