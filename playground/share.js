// A state as a link, as a rig file and as Python that gives the same answer.
import { norm } from "./geometry.js";
import { POLICIES, SOLVERS } from "./rig.js";

export const SHAPES = ["polytope", "workspace", "profile"]; // what can be shown beside the rig
const numbers = (text) => text.split(",").map(Number);
const list = (values) => values.map((x) => String(+x.toPrecision(10))).join(",");

/** The part of a link behind its #: what differs from the rig as it is committed. */
export function toHash(state, show) {
  const parts = { rig: state.rig.name, at: list(state.position), force: list(state.wrench), policy: state.policy };
  if (state.solver !== SOLVERS[0]) parts.solver = state.solver;
  if (state.rig.turns && norm(state.rotation) > 0) parts.turn = list(state.rotation);
  if (show.level) parts.level = String(show.level);
  parts.show = SHAPES.filter((name) => show[name]).join(",");
  if (state.rig.edited) {
    parts.modules = state.rig.modules
      .map(({ name, anchor, attachment, lower, upper }) =>
        [name.replace(/[~;]/g, " "), list(anchor), attachment ? list(attachment) : "", lower, upper].join("~"),
      )
      .join(";");
  }
  return "#" + new URLSearchParams(parts);
}

/** Change a state, fresh from its rig, by what a link says; parts that are not numbers are passed over. */
export function fromHash(hash, rigs, start) {
  const parts = new URLSearchParams(hash.replace(/^#/, ""));
  const state = start(rigs[parts.get("rig")] ? parts.get("rig") : undefined);
  const read = (key, size) => {
    const values = parts.has(key) ? numbers(parts.get(key)) : [];
    return values.length === size && values.every(Number.isFinite) ? values : null;
  };
  if (parts.has("modules")) {
    const modules = parts.get("modules").split(";").map((text) => {
      const [name, anchor, attachment, lower, upper] = text.split("~");
      const module = { name, anchor: numbers(anchor ?? ""), lower: +lower, upper: +upper };
      if (state.rig.turns) module.attachment = numbers(attachment ?? "");
      return module;
    }); // prettier-ignore
    const d = state.rig.dimension;
    const sound = modules.every(
      ({ anchor, attachment, lower, upper }) =>
        [...anchor, ...(attachment ?? []), lower, upper].every(Number.isFinite) &&
        anchor.length === d && (attachment ?? anchor).length === d && lower <= upper,
    ); // prettier-ignore
    if (sound && modules.length <= 32) Object.assign(state.rig, { modules, edited: true });
  }
  state.position = read("at", state.position.length) ?? state.position;
  state.rotation = read("turn", state.rotation.length) ?? state.rotation;
  state.wrench = read("force", state.wrench.length) ?? state.wrench;
  if (POLICIES.includes(parts.get("policy"))) state.policy = parts.get("policy");
  if (SOLVERS.includes(parts.get("solver"))) state.solver = parts.get("solver");
  const shown = parts.has("show") ? parts.get("show").split(",") : ["polytope"];
  const show = { level: Math.max(0, Number(parts.get("level")) || 0), embed: parts.has("embed") };
  for (const name of SHAPES) show[name] = shown.includes(name);
  return { state, show };
}

const toml = (values) => `[${values.map((x) => (Number.isInteger(x) ? x.toFixed(1) : String(x))).join(", ")}]`;

/** Name of the rig file that `toRigFile` fills. */
export const fileName = ({ rig }) => `${rig.name}-edited.toml`;

/** Text of a rig file, for `tensionlab.load_rig`. */
export function toRigFile({ rig }) {
  const lines = [
    `name = "${rig.name}-edited"`,
    `kind = "${rig.kind}"`,
    `up = "${rig.upAxis}"`,
    `home = ${toml(rig.home)}  # m`,
  ];
  if (rig.turns && norm(rig.homeRotation) > 0) lines.push(`home_rotation = ${toml(rig.homeRotation)}  # rad`);
  const required = rig.required.some((x) => x !== 0);
  if (required || rig.weighs) lines.push("", "[required]");
  if (required) lines.push(`wrench = ${toml(rig.required)}`);
  if (rig.weighs) {
    lines.push("gravity = true", "", "[platform]", `mass = ${rig.mass}  # kg`);
    if (rig.com) lines.push(`com = ${toml(rig.com)}  # m`);
  }
  for (const { name, anchor, attachment, lower, upper } of rig.modules) {
    lines.push("", "[[modules]]", `name = ${JSON.stringify(name)}`, `anchor = ${toml(anchor)}  # m`);
    if (attachment) lines.push(`attachment = ${toml(attachment)}  # m`);
    lines.push(`lower = ${toml([lower]).slice(1, -1)}  # N`, `upper = ${toml([upper]).slice(1, -1)}  # N`);
  }
  return lines.join("\n") + "\n";
}

/** Lines of Python that give the answer of a state. */
export function toPython(state) {
  const { rig, position, rotation, wrench, policy, solver } = state;
  const python = (values) => `[${values.map((x) => String(+x.toPrecision(10))).join(", ")}]`;
  const options = [`position=${python(position)}`];
  const imports = ["import tensionlab as tl"];
  if (rig.turns && rig.dimension === 3) {
    imports.push("from scipy.spatial.transform import Rotation");
    options.push(`rotation=Rotation.from_rotvec(${python(rotation)}).as_matrix()`);
  } else if (rig.turns) {
    options.push(`rotation=${rotation[0]}`);
  }
  if (solver !== SOLVERS[0]) options.push(`solver="${solver}"`);
  else if (policy !== "force") options.push(`policy="${policy}"`);
  const name = rig.edited ? fileName(state) : rig.name;
  return [
    ...imports,
    `rig = tl.load_rig("${name}")`,
    `print(rig.allocate(${python(wrench)}, ${options.join(", ")}))`,
  ].join("\n"); // prettier-ignore
}
