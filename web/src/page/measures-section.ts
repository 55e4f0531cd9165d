// The section of the panel with the ruler: what is measured in the panes, until it is removed.

import { h, iconButton, quiet, setText } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import type { ReadyCase } from "../model/case.ts";
import { type NewFinding, middleOf } from "../model/findings.ts";
import type { Isosurface } from "../model/geodesic.ts";
import type { Depths } from "../model/isosurface.ts";
import type { Marked } from "../model/marks.ts";
import {
  type Column,
  type Measure,
  POINTS,
  TOOLS,
  type Tool,
  type Values,
  type Where,
  columnOf,
  valuesOf,
} from "../model/measure.ts";
import { type Vec3, length, subtract } from "../model/space.ts";
import type { ViewState } from "../model/state.ts";
import type { PointTool } from "../panes/point-tool.ts";
import { button, choiceOfButtons, line, press, row } from "./fields.ts";

export interface MeasuresHost {
  readonly shown: ReadyCase;
  state(): ViewState;
  depths(): Depths | null;
  /** Draws the measures in the panes. */
  draw(marked: readonly Marked[]): void;
  /** A measure is to be a finding; its id. */
  keep(finding: NewFinding): string;
  /** Whether there is a finding of this id. */
  isFinding(id: string): boolean;
  /** Scrolls to the panes, where the controls lie below them. */
  lookAtPanes(): void;
  announce(words: string): void;
}

/** A point so near to the one before, in mm, is the same: it ends a line. */
const SAME_MM = 0.05;
const COLOUR = "#7dffa0";

interface Measured {
  readonly measure: Measure;
  readonly values: Values;
  /** Of an area on the surface: the column below it, between two depths. */
  readonly column?: { readonly between: Column; readonly volume_mm3: number };
  /** The finding that it was kept as. */
  readonly kept_as?: string;
}

/** A column reaches so far to either side of its area at first, in mm. */
const COLUMN_MM = 2;

/** What was measured, by case, as long as the page is open. */
const MEASURED = new Map<string, readonly Measured[]>();

export class MeasuresSection implements PointTool {
  readonly element: HTMLElement;
  readonly #host: MeasuresHost;
  readonly #tools: HTMLElement;
  readonly #hint = h("p", { class: "quiet", role: "status" });
  readonly #list = h("ol", { class: "measures" });
  readonly #clear: HTMLButtonElement;
  readonly #finish: HTMLButtonElement;
  readonly #back: HTMLButtonElement;
  #tool: Tool | null = null;
  #measured: readonly Measured[] = [];
  #points: readonly Vec3[] = [];
  #places: readonly Where[] = [];
  #hovered: Vec3 | null = null;
  readonly #keys = (event: KeyboardEvent): void => this.#key(event);

  constructor(host: MeasuresHost) {
    this.#host = host;
    this.#tools = choiceOfButtons(
      t("panel.measure"),
      TOOLS,
      (tool) => t(`measure.${tool}`),
      (tool) => {
        this.choose(tool === this.#tool ? null : tool);
        if (this.isOn) host.lookAtPanes();
      },
    );
    this.#tools.classList.add("tools");
    this.#clear = button(t("measure.clear"), () => this.#put([]));
    this.#finish = button(t("measure.finish"), () => this.#tool && this.#end(this.#tool));
    this.#back = button(t("measure.back"), () => this.#takeBack(), { "aria-keyshortcuts": "Backspace" });
    this.element = h(
      "div",
      { class: "group-body" },
      this.#tools,
      this.#hint,
      row(this.#finish, this.#back),
      h("p", { class: "quiet keys" }, t("measure.keys")),
      this.#list,
      row(this.#clear),
    );
    this.#put(MEASURED.get(host.shown.id) ?? []);
    this.#say();
  }

  get isOn(): boolean {
    return this.#tool !== null;
  }

  /** Takes the ruler up, or lays it down. */
  toggle(): void {
    this.choose(this.isOn ? null : "length");
    this.#host.announce(this.isOn ? (this.#hint.textContent ?? "") : t("measure.off"));
  }

  choose(tool: Tool | null): void {
    this.#tool = tool;
    [this.#points, this.#places, this.#hovered] = [[], [], null];
    press(this.#tools, tool);
    if (tool) document.body.dataset.tool = tool;
    else delete document.body.dataset.tool;
    // Before the panes hear of it: they have Escape of their own.
    if (tool) addEventListener("keydown", this.#keys, true);
    else removeEventListener("keydown", this.#keys, true);
    this.#say();
    this.#draw();
  }

  dispose(): void {
    this.choose(null);
  }

  // -- What hands do

  add(position: Vec3, where: Where): void {
    const tool = this.#tool;
    if (!tool || !position.every(Number.isFinite)) return;
    const last = this.#points.at(-1);
    if (last && length(subtract(position, last)) < SAME_MM) {
      if (this.#isEnough(tool)) this.#end(tool);
      return;
    }
    this.#points = [...this.#points, position];
    this.#places = [...this.#places, where];
    if (this.#points.length === POINTS[tool][1]) return this.#end(tool);
    this.#say();
    this.#draw();
  }

  hover(position: Vec3 | null): void {
    this.#hovered = position;
    if (this.#points.length > 0) this.#draw();
  }

  /** Escape leaves what is begun, then the ruler; Backspace takes the last point back. */
  #key(event: KeyboardEvent): void {
    if (event.target instanceof Element && event.target.closest("input:not([type=range]), textarea, select, dialog"))
      return;
    if (event.key === "Escape") this.choose(this.#points.length > 0 ? this.#tool : null);
    else if (event.key === "Backspace" && this.#points.length > 0) this.#takeBack();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  #takeBack(): void {
    [this.#points, this.#places] = [this.#points.slice(0, -1), this.#places.slice(0, -1)];
    this.#say();
    this.#draw();
  }

  /** Whether as many points are set as a measure needs. */
  #isEnough(tool: Tool): boolean {
    return this.#points.length >= POINTS[tool][0];
  }

  #end(tool: Tool): void {
    const [first] = this.#places;
    const where = this.#places.every((one) => one === first) ? (first ?? "slice") : "both";
    const { depth_mm } = this.#host.state();
    const measure: Measure = { id: crypto.randomUUID(), tool, points_in_patient: this.#points, where, depth_mm };
    [this.#points, this.#places, this.#hovered] = [[], [], null];
    const values = valuesOf(measure, this.#surface(depth_mm));
    const plain = { measure, values };
    const measured =
      tool === "area" && values.along_mm !== undefined && !values.isCrossed
        ? this.#withColumn(plain, [Math.max(depth_mm - COLUMN_MM, 0), depth_mm + COLUMN_MM])
        : plain;
    this.#put([...this.#measured, measured]);
    this.#say();
    this.#host.announce(wordsOf(measured));
  }

  #withColumn(measured: Measured, between: Column): Measured {
    const surface = this.#surface(measured.measure.depth_mm);
    const volume_mm3 = surface ? columnOf(measured.measure, surface, between) : NaN;
    const { kept_as: _kept, ...rest } = measured;
    return { ...rest, column: { between, volume_mm3 } };
  }

  #surface(depth_mm: number): Isosurface | null {
    const depths = this.#host.depths();
    const center = this.#host.shown.envelope_sphere.center_in_patient;
    return depths && { depths, depth_mm, center };
  }

  // -- What is shown

  /** The findings have changed: a measure whose finding was removed can be kept again. */
  listed(): void {
    const kept = this.#measured.filter((one) => this.#isKept(one)).length;
    const said = this.#list.querySelectorAll("button:disabled").length;
    if (kept !== said) this.#list.replaceChildren(...this.#items());
  }

  #isKept({ kept_as }: Measured): boolean {
    return kept_as !== undefined && this.#host.isFinding(kept_as);
  }

  #items(): readonly HTMLElement[] {
    return this.#measured.map((one) => this.#item(one));
  }

  #say(): void {
    const tool = this.#tool;
    const set = this.#points.length;
    const canEnd = tool !== null && POINTS[tool][1] === Infinity && this.#isEnough(tool);
    this.#finish.hidden = !canEnd;
    this.#back.hidden = set === 0;
    if (!tool) return setText(this.#hint, t("measure.hint"));
    const key = canEnd ? "measure.end" : "measure.next";
    setText(this.#hint, t(key, { tool: t(`measure.${tool}`), point: number(set + 1) }));
  }

  #put(measured: readonly Measured[]): void {
    this.#measured = measured;
    MEASURED.set(this.#host.shown.id, measured);
    this.#clear.disabled = measured.length === 0;
    this.#list.replaceChildren(...this.#items());
    this.#draw();
  }

  #item(measured: Measured): HTMLElement {
    const { measure, values } = measured;
    const words = wordsOf(measured);
    const isKept = this.#isKept(measured);
    const label = t(isKept ? "measure.kept" : "measure.keep");
    const keep = button(
      label,
      () => {
        const note = [words, columnWords(measured)].filter(Boolean).join("\n");
        const kept_as = this.#host.keep(findingOf({ ...measure, depth_mm: this.#depthOf(measure) }, note));
        this.#put(this.#measured.map((one) => (one === measured ? { ...measured, kept_as } : one)));
      },
      { "aria-label": `${words}: ${label}`, ...(isKept && { disabled: "" }) },
    );
    const remove = iconButton("trash", t("findings.remove", { name: words }), () =>
      this.#put(this.#measured.filter((one) => one !== measured)),
    );
    const straight = values.along_mm === undefined ? null : quiet(t("measure.straight", lengthsOf(values)));
    const value = h("span", { class: "value" }, words);
    return h("li", { "data-tool": measure.tool }, value, straight, this.#columnOf(measured), row(keep, remove));
  }

  /** The depth of a measure as a finding: of what was set in slices that of its middle, if it is known. */
  #depthOf({ where, points_in_patient, depth_mm }: Measure): number {
    const depths = this.#host.depths();
    const own_mm = where !== "surface" && depths ? depths.depthAt(middleOf({ points_in_patient })) : depth_mm;
    return Number.isFinite(own_mm) ? own_mm : depth_mm;
  }

  /** The depths of a column, to be changed; null: there is none. */
  #columnOf(measured: Measured): HTMLElement | null {
    const { column } = measured;
    if (!column) return null;
    const inputs = column.between.map((depth_mm, at) =>
      h("input", {
        type: "number",
        min: 0,
        max: Math.floor(this.#host.shown.max_depth_mm),
        step: 0.5,
        value: depth_mm,
        "aria-label": t(at === 0 ? "measure.column-from" : "measure.column-to"),
        change: () => {
          const [from = 0, to = 0] = inputs.map(({ valueAsNumber }) => valueAsNumber || 0);
          const changed = this.#withColumn(measured, [from, to]);
          this.#put(this.#measured.map((one) => (one === measured ? changed : one)));
          this.#host.announce(columnWords(changed));
          const focused = this.#list.querySelectorAll<HTMLInputElement>(`[data-id="${measured.measure.id}"] input`);
          focused[at]?.focus();
        },
      }),
    );
    const element = line(t("measure.column"), ...inputs, h("span", { class: "quiet", "aria-hidden": "true" }, "mm"));
    element.dataset.id = measured.measure.id;
    return h("div", { class: "column" }, element, quiet(columnWords(measured)));
  }

  /** What is measured, and what is being drawn up to the pointer. */
  #draw(): void {
    const done = this.#measured.map(({ measure, values }) => markedOf(measure, values, shortWords(measure, values)));
    const tool = this.#tool;
    const points = this.#hovered && this.#points.length > 0 ? [...this.#points, this.#hovered] : this.#points;
    if (!tool || points.length === 0) return this.#host.draw(done);
    const isOnSurface = this.#places[0] === "surface" || tool === "trajectory";
    const [where, { depth_mm }] = [isOnSurface ? "both" : "slice", this.#host.state()] as const;
    const growing: Measure = { id: "", tool, points_in_patient: points, where, depth_mm };
    // A straight line follows the pointer at once.
    const values = points.length > 1 ? valuesOf(growing, null) : { drawn: points };
    const words = points.length >= POINTS[tool][0] ? shortWords(growing, values) : "";
    this.#host.draw([...done, { ...markedOf(growing, values, words), depth_mm: null }]);
  }
}

/** A measure as it is drawn: where it was set, whatever depth is shown. */
function markedOf({ tool, where, depth_mm }: Measure, { drawn }: Values, words: string): Marked {
  return {
    words,
    points_in_patient: drawn,
    isClosed: tool === "area",
    colour: COLOUR,
    depth_mm: where === "surface" ? depth_mm : null,
    isOnSurface: where !== "slice",
    pointsAt: () => drawn,
  };
}

const lengthsOf = ({ straight_mm = NaN, along_mm = NaN }: Values) => ({
  straight: number(straight_mm, 1),
  along: number(along_mm, 1),
});

/** What stands beside a measure in a pane. */
function shortWords({ tool }: Measure, values: Values): string {
  const { straight_mm = NaN, along_mm, angle_deg = NaN, area_mm2 = NaN } = values;
  if (tool === "angle") return Number.isFinite(angle_deg) ? `${number(angle_deg, 1)}°` : "–";
  if (tool === "area") return Number.isFinite(area_mm2) ? `${number(area_mm2)} mm²` : "–";
  return `${number(along_mm ?? straight_mm, 1)} mm`;
}

/** A measure in words. */
function wordsOf({ measure, values }: Measured): string {
  const name = t(`measure.${measure.tool}`);
  if (values.isCrossed) return t("measure.crossed", { name });
  const isAlong = values.along_mm !== undefined;
  const value = shortWords(measure, values);
  if (measure.tool === "area") {
    const around = number(values.along_mm ?? values.straight_mm ?? NaN, 1);
    return t(isAlong ? "measure.area-along" : "measure.area-said", { name, value, around });
  }
  return t(isAlong ? "measure.said-along" : "measure.said", { name, value });
}

/** The volume of the column below an area in words; empty if it has none. */
function columnWords({ column }: Measured): string {
  if (!column) return "";
  const { between, volume_mm3 } = column;
  const [from, to] = between.map((depth_mm) => number(depth_mm, 1));
  const isKnown = Number.isFinite(volume_mm3);
  return t(isKnown ? "measure.column-said" : "measure.column-unknown", { from, to, value: number(volume_mm3) });
}

/** A measure as a finding, whose note says what was measured. */
function findingOf({ tool, points_in_patient, depth_mm }: Measure, note: string): NewFinding {
  const kind = tool === "area" ? "polygon" : tool === "trajectory" ? "trajectory" : "line";
  return { kind, points_in_patient, depth_mm, note };
}
