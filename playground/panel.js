// The panel beside the picture: shows a state and its answer, and changes the state.
import { norm } from "./geometry.js";
import { POLICIES, SOLVERS } from "./rig.js";
import { format, tensionColour } from "./scene.js";
import { SHAPES, fileName, toHash, toPython, toRigFile } from "./share.js";

const element = (id) => document.getElementById(id);
const AXES = ["x", "y", "z"];

/** Make an element with properties, attributes under `set`, and children. */
function make(tag, { set = {}, ...properties } = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  for (const [name, value] of Object.entries(set)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/** Input for a number that calls back with finite numbers only. */
function numberInput(label, step, change) {
  const input = make("input", { type: "number", step });
  input.addEventListener("input", () => {
    if (input.value !== "" && Number.isFinite(input.valueAsNumber)) change(input.valueAsNumber);
  });
  return { input, row: make("label", {}, label, input) };
}

function show(input, value) {
  if (document.activeElement !== input) input.value = String(+value.toPrecision(6));
}

export class Panel {
  /** `app` has `state`, `answer`, `show`, `selected` and the methods that change them. */
  constructor(app, rigs) {
    this.app = app;
    for (const [id, names] of [["rig", Object.keys(rigs)], ["solver", SOLVERS]]) {
      element(id).append(...names.map((name) => make("option", { value: name, textContent: name })));
    }
    element("rig").addEventListener("change", () => app.enter(app.fresh(element("rig").value)));
    element("solver").addEventListener("change", () => app.change({ solver: element("solver").value }));
    for (const policy of POLICIES) {
      const button = make("button", { textContent: policy, onclick: () => app.change({ policy }) });
      element("policies").append(button);
    }
    element("add").addEventListener("click", () => app.addModule());
    element("reset").addEventListener("click", () => app.enter(app.fresh(app.state.rig.name)));
    for (const name of SHAPES) {
      element(name).addEventListener("change", () => app.toggle(name, element(name).checked));
    }
    element("level").addEventListener("input", () => app.toggle("level", element("level").valueAsNumber));
    element("theme").addEventListener("click", () => app.setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));
    element("about").addEventListener("click", () => {
      element("help").hidden = !element("help").hidden;
      element("about").setAttribute("aria-expanded", String(!element("help").hidden));
    });
    element("link").addEventListener("click", () => this.copy("link", location.href.split("#")[0] + toHash(app.state, app.show)));
    element("copy").addEventListener("click", () => this.copy("copy", toPython(app.state)));
    element("file").addEventListener("click", () => {
      const file = new Blob([toRigFile(app.state)], { type: "application/toml" });
      const link = make("a", { href: URL.createObjectURL(file), download: fileName(app.state) });
      link.click();
      URL.revokeObjectURL(link.href);
    });
  }

  async copy(id, text) {
    const label = element(id).textContent;
    try {
      await navigator.clipboard.writeText(text);
      element(id).textContent = "Copied";
    } catch {
      window.prompt("Copy:", text); // pages from a file may not reach the clipboard
    }
    setTimeout(() => (element(id).textContent = label), 1500);
  }

  /** Make the rows and fields of another rig. */
  build() {
    const { app } = this;
    const { rig } = app.state;
    element("rig").value = rig.name;
    const d = rig.dimension;
    const field = (key, i, label, step, factor = 1) =>
      Object.assign(numberInput(label, step, (value) => app.setNumber(key, i, value / factor)), { key, i, factor });
    const torques = !rig.turns ? [] : d === 2 ? ["moment (N·m)"] : AXES.map((axis) => `moment ${axis} (N·m)`);
    const turns = !rig.turns ? [] : d === 2 ? ["turn (°)"] : AXES.map((axis) => `turn ${axis} (°)`);
    this.fields = [
      ...AXES.slice(0, d).map((axis, i) => field("wrench", i, `${axis} (N)`, "any")),
      ...torques.map((label, i) => field("wrench", d + i, label, "any")),
      ...AXES.slice(0, d).map((axis, i) => field("position", i, `${axis} (m)`, "any")),
      ...turns.map((label, i) => field("rotation", i, label, 1, 180 / Math.PI)),
    ];
    const rows = (keys) => this.fields.filter(({ key }) => keys.includes(key)).map(({ row }) => row);
    element("wrench").replaceChildren(...rows(["wrench"]));
    element("pose").replaceChildren(...rows(["position", "rotation"]));
    this.modules = rig.modules.map((module, i) => this.moduleRow(module, i));
    element("modules").replaceChildren(...this.modules.map(({ row }) => row));
  }

  moduleRow(module, i) {
    const { app } = this;
    const value = make("span"), fill = make("i");
    const button = make("button", { className: "module", onclick: () => app.select(app.selected === i ? null : i) },
      make("span", { textContent: module.name }), value, make("span", { className: "bar" }, fill)); // prettier-ignore
    const lower = numberInput("least (N)", "any", (number) => app.setLimit(i, "lower", number));
    const upper = numberInput("most (N)", "any", (number) => app.setLimit(i, "upper", number));
    const remove = make("button", { textContent: "Remove", onclick: () => app.removeModule(i) });
    const limits = make("div", { className: "limits" }, lower.row, upper.row, remove);
    return { row: make("div", {}, button, limits), value, fill, limits, lower, upper };
  }

  /** Show the state and its answer. */
  update({ margin, reason, speed }) {
    const { state, answer, selected, theme } = this.app;
    const { status } = answer;
    element("verdict").textContent = status ?? "No answer";
    element("verdict").dataset.status = status ?? "";
    element("reason").textContent = reason;
    element("solver").value = state.solver;
    element("policies").hidden = state.solver !== SOLVERS[0];
    [...element("policies").children].forEach((button) =>
      button.setAttribute("aria-pressed", String(button.textContent === state.policy)),
    );
    state.rig.modules.forEach((module, i) => {
      const { value, fill, limits, lower, upper } = this.modules[i];
      const known = status !== null && status !== "FAILED";
      const share = (answer.tensions[i] - module.lower) / (module.upper - module.lower || 1);
      value.textContent = known ? `${format(answer.tensions[i])} N` : "–";
      fill.style.width = `${known ? Math.max(2, 100 * share) : 0}%`;
      fill.style.background = tensionColour(theme, share);
      limits.hidden = selected !== i;
      show(lower.input, module.lower);
      show(upper.input, module.upper);
    });
    for (const { input, key, i, factor } of this.fields) show(input, state[key][i] * factor);
    for (const name of SHAPES) element(name).checked = this.app.show[name];
    element("level-row").hidden = !this.app.show.workspace;
    element("level").max = String(Math.max(this.app.largestMargin, 1e-9));
    show(element("level"), this.app.show.level);
    element("level-value").textContent = format(this.app.show.level);
    element("python").textContent = toPython(state);
    element("speed").textContent = `Capacity margin here ${format(margin)} N. ${speed}`;
  }
}

/** Sentence that explains an answer. */
export function explain({ state, answer }) {
  const unit = state.rig.turns ? "wrench" : "force";
  switch (answer.status) {
    case "EXACT":
      return `The cables render the desired ${unit}, each within its limits. Checked.`;
    case "NEAREST": {
      const missing = norm(answer.rendered.map((x, i) => x - state.wrench[i]));
      return `No tensions within the limits render this ${unit}: the plane proves it. This is the nearest answer by the policy, ${format(missing)} N away.`;
    }
    case "UNPROVEN":
      return `Tensions within the limits that do not render this ${unit}, and no proof that none do.`;
    default:
      return "A cable has no length or the limits cross: there is nothing to pull with.";
  }
}
