// All that is known of the case that is shown: what changes it calls a method, and what depends on it follows its signals.

import { batch, computed, effect, signal } from "@preact/signals";

import { Problem } from "../base/api.ts";
import { problemWords, troubleWords } from "../base/problem-words.ts";
import type { ReadyCase } from "../model/case.ts";
import { turnedTo } from "../model/commands.ts";
import type { Change } from "../model/controls.ts";
import type { StateHistory } from "../model/history.ts";
import { isAdded, isReady } from "../model/layers.ts";
import type { MaskBlock } from "../model/mask.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import { type HalfLook, type Layout, type ViewState, viewSize } from "../model/state.ts";
import { announce, note } from "./announce.ts";
import { CaseLayers } from "./case-layers.ts";
import { Cine } from "./cine.ts";
import { Findings } from "./findings.ts";
import { Measures } from "./measures.ts";
import { Places } from "./places.ts";
import { MarkedPoint } from "./point.ts";
import { type Task, choose, preferences } from "./preferences.ts";
import { Reading } from "./reading.ts";
import { Rows } from "./rows.ts";
import { ShownLayers } from "./shown-layers.ts";
import type { LoadProgress, Surface, SurfaceStatus } from "./surface.ts";
import { Sweep } from "./sweep.ts";
import { View } from "./view.ts";

/** How far the loading of a case is; null: it is over. */
export type Loading = LoadProgress | "begun" | "cancelled" | null;

/** In a window that is not wider, pictures have the height that is left to them, as in the style sheet. */
const ROOMY_PIXELS = 860;

export class Store {
  readonly shown: ReadyCase;
  readonly view: View;
  readonly sweep: Sweep;
  readonly cine: Cine;
  readonly caseLayers: CaseLayers;
  readonly layers: ShownLayers;
  readonly places: Places;
  readonly findings: Findings;
  readonly reading: Reading;
  readonly rows: Rows;
  readonly measures: Measures;
  readonly point: MarkedPoint;
  readonly status = signal<SurfaceStatus | null>(null);
  /** The state as the panes draw it. */
  readonly drawn = computed(() => this.places.outlined(this.layers.drawn.value));
  readonly marked = computed(() => [...this.findings.marked.value, ...this.measures.marked.value]);
  readonly loading = signal<Loading>(null);
  /** Whether all that could be loaded is here. */
  readonly isLoaded = signal(false);
  /** The step of the protocol that was gone to last; null: none yet. */
  readonly step = signal<string | null>(null);
  /** What went wrong; empty: nothing. */
  readonly trouble = signal("");
  /** Something about the case to know, which can be dismissed. */
  readonly remark = signal("");
  /** Whose head it is; empty: nobody may know, or it is not known yet. */
  readonly patient = signal("");
  /** The nodes of a PACS to which results can be sent. */
  readonly nodes = signal<readonly string[]>([]);
  /** Why only the whole brain has a surface; empty: its parts have, too. */
  readonly refusal = signal("");
  /** Whether its case has been left: what was asked for then says and shows nothing any more. */
  isOver = false;
  /** Whose sections the panel shows. */
  readonly task = signal<Task>(preferences.peek().task);
  /** Whether a hand rests on a pane: pictures in between may be coarse. */
  readonly isMoving = signal(false);
  readonly isResting = signal(false);
  /** Whether all that lies over the head is hidden, as long as a key is held. */
  readonly isBare = signal(false);
  /** Whether the pictures are all there is of the page. */
  readonly isAlone = signal(false);
  /** Whether a drag moves what a picture shows, as long as nobody measures. */
  readonly hasHand = signal(false);
  readonly moves = computed(() => this.hasHand.value && this.measures.tool.value === null);
  /** Whether outlines are shown: in a close-up, where they would lie on what is judged, if they are asked for. */
  readonly outlined = signal({ slices: true, closer: false });
  /** Whether the strip of series is shown; null: where there is room, as soon as there is more than the case itself. */
  readonly hasStrip = signal<boolean | null>(null);
  readonly isStripShown = computed(() => {
    const hasMore = this.caseLayers.list.value?.layers.some((one) => isAdded(one) && isReady(one)) ?? false;
    return this.hasStrip.value ?? (hasMore && globalThis.innerWidth > ROOMY_PIXELS);
  });
  readonly hasTimer = signal(false);
  /** The mask, while its outline is shown in slices. */
  readonly mask = signal<MaskBlock | null>(null);
  /** The pane that is as large as all of them. */
  readonly large = signal<string | null>(null);
  /** Counts how often all is to be seen as at first. */
  readonly centred = signal(0);
  /** Counts how often the panes are to be brought into sight, where the controls lie below them. */
  readonly looks = signal(0);
  /** The size of the pane of the surface. */
  paneSize: () => Vec2 = () => [0, 0];
  /** What the close-up was opened from. */
  beforeCloser: Partial<ViewState> & Pick<ViewState, "layout"> = { layout: "both", beside: null };
  /** The layout that the slice across the sulcus was opened from. */
  beforeAcross: Layout | null = null;
  /** A click before it was known where the surface is. */
  wanted: { readonly place: Vec2; readonly state: ViewState } | null = null;
  /** A place that is shown as soon as the inner side on which it is seen is here, by its depth below the whole brain. */
  awaited: { readonly position: Vec3; readonly depth_mm: number } | null = null;
  readonly #first_mm: number;
  #surface: Surface | null = null;
  /** Counts how often more was known of the surface. */
  readonly #known = signal(0);
  /** What was undone, the last at the end. */
  readonly #undone: ("view" | "findings")[] = [];
  /** What was shown before a hand moved the cross in a slice: one step back undoes its whole way. */
  #unmoved: ViewState | null = null;
  /** What was shown before each of the last two clicks in a slice: a double click enlarges it and moves nothing. */
  #unclicked: readonly (ViewState | undefined)[] = [];
  readonly #end: () => void;

  constructor(shown: ReadyCase, first: ViewState, history: StateHistory) {
    this.shown = shown;
    this.view = new View(shown, first, history);
    this.#first_mm = first.depth_mm;
    this.sweep = new Sweep(this.view);
    this.cine = new Cine(this.view, (position) => this.moveCross(position, false));
    this.caseLayers = new CaseLayers(shown.id);
    this.layers = new ShownLayers(this.view, this.caseLayers, (problem) => this.complain(problem));
    this.places = new Places(this.view, this.caseLayers);
    const depths = computed(() => this.surface?.depths ?? null);
    this.findings = new Findings(this.view, depths, (position) => this.surface?.wholeDepth(position) ?? null);
    this.reading = Reading.of(shown.id, this.findings.list);
    this.rows = new Rows(this.places, this.findings);
    this.measures = new Measures(this.view, depths, this.findings);
    this.point = new MarkedPoint(this.view, () => this.surface, this.layers);
    const flairOf = computed(() => this.caseLayers.list.value?.layers.find(({ id }) => id === "flair")?.of_layer);
    let before: string | undefined;
    // The voxels of the map are others now.
    this.#end = effect(() => {
      if (flairOf.value === before) return;
      before = flairOf.value;
      this.caseLayers.forget("flair");
      this.#surface?.forgetLayer("flair");
    });
  }

  dispose(): void {
    this.isOver = true;
    this.#end();
    this.sweep.stop();
    this.cine.stop();
    this.caseLayers.dispose();
    const { layers, places, rows, findings, reading, measures, point } = this;
    for (const part of [layers, places, rows, findings, reading, measures, point]) part.dispose();
  }

  /** Who draws the surface and knows its points; what follows this hears when more is known. */
  get surface(): Surface | null {
    return this.#known.value >= 0 ? this.#surface : null;
  }

  /** The surface is drawn by this, and more may be known of it. */
  meet(surface: Surface): void {
    this.#surface = surface;
    this.#known.value += 1;
  }

  /** What sets points, while a reader measures. */
  get tool(): Measures | null {
    return this.measures.isOn ? this.measures : null;
  }

  /** The size of the picture of one view: beside the mirrored one a half of the pane. */
  get size(): Vec2 {
    return viewSize(this.view.now, this.paneSize());
  }

  /** A change by a control; `step` is one that Back undoes. */
  change(change: Change, step = false): boolean {
    this.sweep.stop();
    return this.view.change(change, step);
  }

  /** A change by a control of what is seen in the pane that a hand was in last. */
  changeLook(change: Partial<HalfLook>, step = false): void {
    this.sweep.stop();
    this.view.changeLook(change, step);
  }

  /** Shows another state in the place of this one. */
  take(state: ViewState): void {
    this.sweep.stop();
    this.point.picked = null;
    this.view.take(state);
  }

  complain(problem: unknown): void {
    this.trouble.value = troubleWords(problem);
  }

  miss(words: string): void {
    this.point.missed.value = words;
    note(words);
  }

  /** Puts the cross where a slice was touched; the surface turns to it when the hand has left. */
  moveCross(position: Vec3, isDone: boolean): void {
    this.point.picked = null;
    this.#unmoved ??= this.view.now;
    batch(() => {
      if (isDone) {
        this.#unclicked = [this.#unclicked[1], this.#unmoved ?? undefined];
        if (this.#unmoved) this.view.state.value = this.#unmoved;
        this.#unmoved = null;
      }
      this.view.change({ crosshair_mm: position, ...(isDone ? turnedTo(position, this.shown) : {}) }, isDone);
    });
  }

  forgetCross(): void {
    this.point.picked = null;
    this.change({ crosshair_mm: null }, true);
  }

  /** Shows a pane as large as all of them, or all again. */
  enlarge(pane: string, isDoubleClick = false): void {
    this.large.value = this.large.peek() === pane ? null : pane;
    // A hand that moves has marked nothing.
    if (isDoubleClick && !this.moves.peek() && this.#unclicked[0]) this.take(this.#unclicked[0]);
  }

  /** Nothing has changed for a while. */
  rest(): void {
    this.#unmoved = null;
    this.view.rest();
    this.isResting.value = true;
    // Whoever has changed the depth knows how.
    const isChanged = this.view.now.depth_mm !== this.#first_mm;
    if (isChanged && !preferences.peek().knows_depth) choose({ knows_depth: true });
  }

  /** Undoes what was done last, to the view or to the findings, or does again what was undone last; whether there was anything. */
  goTo(which: "undo" | "redo"): boolean {
    const { findings, view } = this;
    const { done_ms } = findings;
    const isOfFindings =
      which === "undo"
        ? done_ms !== null && done_ms >= (view.done_ms ?? 0)
        : this.#undone.at(-1) === "findings" || !view.canRedo.peek();
    const canGo = which === "undo" ? findings.canUndo.peek() : findings.canRedo.peek();
    if (isOfFindings && canGo) findings[which]();
    else {
      this.sweep.stop();
      this.point.picked = null;
      if (!view.goTo(which)) return false;
    }
    if (which === "undo") this.#undone.push(isOfFindings && canGo ? "findings" : "view");
    else this.#undone.pop();
    return true;
  }

  /** Says that a part of the brain cannot be shown, and why. */
  refusePart(problem: unknown): void {
    const words = problemWords(problem);
    if (problem instanceof Problem && problem.kind === "no-surfaces") this.refusal.value = words;
    this.remark.value = words;
    announce(words);
  }
}
