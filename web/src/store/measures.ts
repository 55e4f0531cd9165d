// The ruler: points that a reader sets in the panes, and what was measured with them until it is removed.

import { type ReadonlySignal, type Signal, computed, effect, signal } from "@preact/signals";

import { number, t } from "../base/i18n.ts";
import { type NewFinding, middleOf } from "../model/findings.ts";
import type { Isosurface } from "../model/geodesic.ts";
import type { Depths } from "../model/isosurface.ts";
import type { Marked } from "../model/marks.ts";
import {
  areCommissures,
  isWay,
  type Column,
  type Measure,
  POINTS,
  type Tool,
  type Values,
  type Where,
  columnOf,
  valuesOf,
} from "../model/measure.ts";
import { type Vec3, distance } from "../model/space.ts";
import { announce, note as say } from "./announce.ts";
import type { Findings } from "./findings.ts";
import type { View } from "./view.ts";

/** A point so near to the one before, in mm, is the same: it ends a line. */
const SAME_MM = 0.05;
const COLOUR = "#7dffa0";
/** A column reaches so far to either side of its area at first, in mm. */
const COLUMN_MM = 2;

export interface Measured {
  readonly measure: Measure;
  readonly values: Values;
  /** Of an area on the surface: the column below it, between two depths. */
  readonly column?: { readonly between: Column; readonly volume_mm3: number };
  /** The finding that it was kept as. */
  readonly kept_as?: string;
}

interface SetPoint {
  readonly position: Vec3;
  readonly where: Where;
}

/** What was measured, by case, as long as the page is open. */
const MEASURED = new Map<string, Signal<readonly Measured[]>>();

export class Measures {
  readonly tool = signal<Tool | null>(null);
  readonly list: Signal<readonly Measured[]>;
  /** As they are drawn: what is measured, and what is being drawn up to the pointer. */
  readonly marked: ReadonlySignal<readonly Marked[]>;
  readonly count = computed(() => this.#points.value.length);
  /** What to do next. */
  readonly hint = computed(() => this.#hint());
  readonly canEnd = computed(() => {
    const tool = this.tool.value;
    return tool !== null && POINTS[tool][1] === Infinity && this.#isEnough(tool);
  });
  readonly #view: View;
  readonly #depths: ReadonlySignal<Depths | null>;
  readonly #findings: Findings;
  readonly #points = signal<readonly SetPoint[]>([]);
  readonly #hovered = signal<Vec3 | null>(null);
  readonly #end: () => void;

  constructor(view: View, depths: ReadonlySignal<Depths | null>, findings: Findings) {
    this.#view = view;
    this.#depths = depths;
    this.#findings = findings;
    const { id } = view.shown;
    this.list = MEASURED.get(id) ?? signal([]);
    MEASURED.set(id, this.list);
    // A finding is drawn once.
    const own = computed(() => this.list.value.filter((one) => !this.isKept(one)));
    this.marked = computed(() => [...own.value.map(markedOf), ...this.#growing()]);
    // Before the panes hear of it: they have Escape of their own.
    this.#end = effect(() => {
      const tool = this.tool.value;
      if (!tool) return undefined;
      document.body.dataset.tool = tool;
      addEventListener("keydown", this.#key, true);
      return () => {
        delete document.body.dataset.tool;
        removeEventListener("keydown", this.#key, true);
      };
    });
  }

  dispose(): void {
    this.#end();
  }

  get isOn(): boolean {
    return this.tool.peek() !== null;
  }

  /** Takes the ruler up, or lays it down. */
  toggle(): void {
    this.choose(this.isOn ? null : "length");
    announce(this.isOn ? this.hint.peek() : t("measure.off"));
  }

  choose(tool: Tool | null): void {
    this.tool.value = tool;
    this.#points.value = [];
    this.#hovered.value = null;
  }

  // -- What hands do

  /** A point was set; where the last one is, it ends what is drawn. */
  add(position: Vec3, where: Where): void {
    const tool = this.tool.peek();
    if (!tool || !position.every(Number.isFinite)) return;
    const last = this.#points.peek().at(-1);
    if (last && distance(position, last.position) < SAME_MM) {
      if (this.#isEnough(tool)) this.end();
      return;
    }
    this.#points.value = [...this.#points.peek(), { position, where }];
    if (this.#points.peek().length === POINTS[tool][1]) this.end();
  }

  /** The pointer is here; null: nowhere. */
  hover(position: Vec3 | null): void {
    this.#hovered.value = position;
  }

  takeBack(): void {
    this.#points.value = this.#points.peek().slice(0, -1);
  }

  /** Measures with the points that are set. */
  end(): void {
    const tool = this.tool.peek();
    const points = this.#points.peek();
    const [first] = points;
    if (!tool || !first) return;
    const where = points.every((one) => one.where === first.where) ? first.where : "both";
    const { depth_mm } = this.#view.now;
    const points_in_patient = points.map(({ position }) => position);
    const measure: Measure = { id: crypto.randomUUID(), tool, points_in_patient, where, depth_mm };
    this.choose(tool);
    const values = valuesOf(measure, this.#surface(depth_mm));
    const plain = { measure, values };
    const measured =
      tool === "area" && values.along_mm !== undefined && !values.isCrossed
        ? this.#withColumn(plain, [Math.max(depth_mm - COLUMN_MM, 0), depth_mm + COLUMN_MM])
        : plain;
    this.list.value = [...this.list.peek(), measured];
    announce(wordsOf(measured));
  }

  /** Escape leaves what is begun, then the ruler; Backspace takes the last point back. */
  readonly #key = (event: KeyboardEvent): void => {
    if (event.target instanceof Element && event.target.closest("input:not([type=range]), textarea, select, dialog"))
      return;
    // Escape closes the box of a tool first.
    if (document.querySelector(".menu:popover-open")) return;
    const isBegun = this.#points.peek().length > 0;
    if (event.key === "Escape") this.choose(isBegun ? this.tool.peek() : null);
    else if (event.key === "Backspace" && isBegun) this.takeBack();
    else return;
    event.preventDefault();
    event.stopPropagation();
  };

  // -- What was measured

  /** Whether a measure is a finding, too. */
  isKept({ kept_as }: Measured): boolean {
    return kept_as !== undefined && this.#findings.list.value.some(({ id }) => id === kept_as);
  }

  keep(measured: Measured): void {
    const { measure, values } = measured;
    if (measure.tool === "acpc" && !areCommissures(values.straight_mm ?? NaN)) return say(t("measure.acpc-apart"));
    const note = [wordsOf(measured), columnWords(measured)].filter(Boolean).join("\n");
    const kept_as = this.#findings.take(findingOf({ ...measure, depth_mm: this.#depthOf(measure) }, note));
    this.#replace(measured, { ...measured, kept_as });
  }

  remove(measured: Measured): void {
    this.list.value = this.list.peek().filter((one) => one !== measured);
  }

  /** Measures the column below an area between other depths. */
  bound(measured: Measured, between: Column): void {
    const changed = this.#withColumn(measured, between);
    this.#replace(measured, changed);
    announce(columnWords(changed));
  }

  #replace(measured: Measured, by: Measured): void {
    this.list.value = this.list.peek().map((one) => (one === measured ? by : one));
  }

  #withColumn(measured: Measured, between: Column): Measured {
    const surface = this.#surface(measured.measure.depth_mm);
    const volume_mm3 = surface ? columnOf(measured.measure, surface, between) : NaN;
    const { kept_as: _kept, ...rest } = measured;
    return { ...rest, column: { between, volume_mm3 } };
  }

  #surface(depth_mm: number): Isosurface | null {
    const depths = this.#depths.peek();
    const center = this.#view.shown.envelope_sphere.center_in_patient;
    return depths && { depths, depth_mm, center };
  }

  /** The depth of a measure as a finding: of what was set in slices that of its middle, if it is known. */
  #depthOf({ where, points_in_patient, depth_mm }: Measure): number {
    const depths = this.#depths.peek();
    const own_mm = where !== "surface" && depths ? depths.depthAt(middleOf({ points_in_patient })) : depth_mm;
    return Number.isFinite(own_mm) ? own_mm : depth_mm;
  }

  /** Whether as many points are set as a measure needs. */
  #isEnough(tool: Tool): boolean {
    return this.#points.value.length >= POINTS[tool][0];
  }

  #hint(): string {
    const tool = this.tool.value;
    if (!tool) return t("measure.hint");
    if (tool === "acpc") return t(this.count.value === 0 ? "measure.ac" : "measure.pc");
    const key = this.canEnd.value ? "measure.end" : "measure.next";
    return t(key, { tool: t(`measure.${tool}`), point: number(this.count.value + 1) });
  }

  /** What is being drawn up to the pointer. */
  #growing(): readonly Marked[] {
    const tool = this.tool.value;
    const set = this.#points.value;
    const [first] = set;
    if (!tool || !first) return [];
    const hovered = this.#hovered.value;
    const points = [...set.map(({ position }) => position), ...(hovered ? [hovered] : [])];
    const isOnSurface = first.where === "surface" || isWay(tool);
    const measure: Measure = {
      id: "",
      tool,
      points_in_patient: points,
      where: isOnSurface ? "both" : "slice",
      depth_mm: this.#view.now.depth_mm,
    };
    // A straight line follows the pointer at once.
    const values = points.length > 1 ? valuesOf(measure, null) : { drawn: points };
    const words = points.length >= POINTS[tool][0] ? shortWords(measure, values) : "";
    return [{ ...drawnAs(measure, values, words), depth_mm: null }];
  }
}

const markedOf = ({ measure, values }: Measured): Marked => drawnAs(measure, values, shortWords(measure, values));

/** A measure as it is drawn: where it was set, whatever depth is shown. */
function drawnAs({ tool, where, depth_mm }: Measure, { drawn }: Values, words: string): Marked {
  return {
    words,
    points_in_patient: drawn,
    isClosed: tool === "area",
    colour: COLOUR,
    depth_mm: where === "surface" ? depth_mm : null,
    isOnSurface: where !== "slice",
    isValue: true,
    pointsAt: () => drawn,
  };
}

/** What stands beside a measure in a pane. */
function shortWords({ tool }: Measure, values: Values): string {
  const { straight_mm = NaN, along_mm, angle_deg = NaN, area_mm2 = NaN } = values;
  if (tool === "angle") return Number.isFinite(angle_deg) ? `${number(angle_deg, 1)}°` : "–";
  if (tool === "area") return Number.isFinite(area_mm2) ? `${number(area_mm2)} mm²` : "–";
  return `${number(along_mm ?? straight_mm, 1)} mm`;
}

export function wordsOf({ measure, values }: Measured): string {
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
export function columnWords({ column }: Measured): string {
  if (!column) return "";
  const { between, volume_mm3 } = column;
  const [from, to] = between.map((depth_mm) => number(depth_mm, 1));
  const isKnown = Number.isFinite(volume_mm3);
  return t(isKnown ? "measure.column-said" : "measure.column-unknown", { from, to, value: number(volume_mm3) });
}

/** A measure as a finding, whose note says what was measured. */
function findingOf({ tool, points_in_patient, depth_mm }: Measure, note: string): NewFinding {
  const kind = tool === "area" ? "polygon" : isWay(tool) ? tool : "line";
  return { kind, points_in_patient, depth_mm, note };
}
