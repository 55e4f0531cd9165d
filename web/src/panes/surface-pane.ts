// The pane of the surface: the picture, what stands on it, and the hands on it.

import { dragTheWindow, turnTheWheel } from "./slice-parts.ts";
import { effect } from "@preact/signals";

import { type View, edgesOf, mirrored, project, towardsViewer, viewName } from "../model/camera.ts";
import type { MirrorPlane, ReadyCase } from "../model/case.ts";
import { pan, pinch, turn, zoomAt } from "../model/controls.ts";
import { type Mark, type Marked, surfaceMarks } from "../model/marks.ts";
import { type SideSeen, plainPlane, reflected, sideOf, sideSeen } from "../model/midsagittal.ts";
import type { Picked } from "../model/points.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import {
  type HalfLook,
  type Place,
  type ViewState,
  isHalved,
  isMirrored,
  isStacked,
  leftOf,
  stateIn,
  viewSize,
} from "../model/state.ts";
import { type SurfaceName, isHalf, isPart, mirroredSurface } from "../model/surfaces.ts";
import { caseIdentity } from "../base/case-words.ts";
import { h, iconButton, setText, tell } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import { depthWords } from "../base/readout.ts";
import { leavePart } from "../store/bring.ts";
import { perform, pick } from "../store/commands.ts";
import type { Store } from "../store/store.ts";
import { Cortex } from "./cortex.ts";
import { Cube } from "./cube.ts";
import { type Gestures, listen } from "./gestures.ts";
import { MapBar } from "./map-bar.ts";
import { ColourBar, Overlay, SIDES, lookWords } from "./overlay.ts";
import type { SurfaceOptions, SurfaceStatus } from "../store/surface.ts";

/** A marked point that lies farther than this behind what is seen of the surface, or before it, is not on it. */
const HIDDEN_MM = 3;

const OPPOSITE = { left: "right", right: "left", middle: "middle" } as const;

export class SurfacePane {
  readonly element: HTMLElement;
  /** What the picture is in. */
  readonly host = h("div", { class: "surface-host" });
  readonly #shown: ReadyCase;
  readonly #store: Store;
  readonly #overlay: Overlay;
  readonly #otherOverlay: Overlay;
  /** Those of the right half, or of the whole, then those of the left half. */
  readonly #bars = [
    [new ColourBar(), new MapBar()],
    [new ColourBar(), new MapBar()],
  ] as const;
  readonly #leftBars = h("div", { class: "of-left" });
  readonly #cube = new Cube((name) => perform(this.#store, { kind: "view", name }));
  readonly #keys = h("p", { id: "surface-keys", class: "visually-hidden" }, t("surface.keys"));
  /** What the picture waits for. */
  readonly #awaited = h("p", { class: "awaited", role: "status", hidden: true });
  /** Who draws it, and knows its points. */
  readonly surface: Cortex;
  /** The state of the picture that is up; null: none is. */
  #drawn: ViewState | null = null;
  #marked: readonly Marked[] = [];
  /** What the marks that are drawn depend on. */
  #laid: readonly unknown[] = [];
  #ghost: Vec2 | null = null;

  constructor(store: Store, source: Pick<SurfaceOptions, "serverOnly" | "shared">) {
    const { shown } = store;
    this.#shown = shown;
    this.#store = store;
    this.element = h(
      "section",
      {
        class: "pane surface",
        id: "surface",
        role: "application",
        tabindex: 0,
        "aria-label": t("surface.label"),
        "aria-describedby": "surface-keys",
        "data-pane": "surface",
      },
      this.host,
    );
    this.#overlay = new Overlay(this.element);
    this.#overlay.identity(caseIdentity(shown));
    this.#otherOverlay = new Overlay(this.element);
    this.#otherOverlay.identity(caseIdentity(shown));
    this.#otherOverlay.element.classList.add("other");
    this.element.append(...SIDES.map((side) => h("span", { class: `ring ${side}` })));
    const [[colours, map], left] = this.#bars;
    this.element.append(colours.element, map.element);
    this.#leftBars.append(...left.map(({ element }) => element));
    // As large as all panes, where there are others.
    const enlarge = iconButton("enlarge", t("surface.enlarge"), () => store.enlarge("surface"));
    const note = h("p", { class: "bare-note" }, t("outline.off"));
    this.element.append(this.#cube.element, this.#keys, enlarge, note, this.#awaited);
    const options: SurfaceOptions = {
      onDrawn: (state) => this.#onDrawn(state),
      onStatus: (status) => this.#onStatus(status),
      layer: (name) => store.caseLayers.voxels(name),
      noPart: (problem) => leavePart(store, problem),
      ...source,
    };
    this.surface = new Cortex(this.host, shown, options);
    store.paneSize = () => this.#whole;
    store.meet(this.surface);
    effect(() => void this.element.classList.toggle("large", store.large.value === "surface"));
    listen(this.element, this.#gestures(), store.moves);
    this.element.addEventListener("pointermove", (event) => this.#hover(event));
    this.element.addEventListener("pointerleave", () => this.#hover(null));
  }

  draw(state: ViewState, moving: boolean): void {
    const seen = stateIn(state, "surface");
    this.surface.draw(seen, moving);
    this.#tellAwaited(seen);
  }

  /** The size of the picture of one view: beside the mirrored one a half of the pane. */
  size(state: ViewState = this.#store.view.now): Vec2 {
    return viewSize(state, this.#whole);
  }

  get #whole(): Vec2 {
    return [this.element.clientWidth, this.element.clientHeight];
  }

  /** What is seen at a place of the pane. */
  pick(place: Vec2): Picked | null {
    return this.#drawn && this.surface.pick(this.#drawn, ...place);
  }

  describe(words: string): void {
    setText(this.#keys, `${words} ${t("surface.keys")}`);
  }

  /** The surface and the layers that are seen, which can be fewer than those of a state, and the window that belongs to them. */
  get layers(): Pick<ViewState, "surface" | "beside" | keyof HalfLook> {
    const none = { layer: null, overlay: null, beside: null } as const;
    const now = this.#now;
    const { surface, layer, overlay, window, beside, colormap } = this.#drawn ?? { ...now, ...none };
    return { surface, layer, overlay, window, beside, colormap };
  }

  /** The state with the pane's own series. */
  get #now(): ViewState {
    return stateIn(this.#store.view.now, "surface");
  }

  async picture(ratio: number): Promise<CanvasImageSource> {
    // A pane without a picture is black.
    if (!this.#drawn) return h("canvas", {});
    return this.surface.picture({ ...this.#store.view.now, ...this.layers, swipe: null }, ratio);
  }

  // -- What stands on the picture

  #onDrawn(state: ViewState | null): void {
    this.#drawn = state;
    this.element.classList.toggle("blank", state === null);
    this.element.dataset.drawn = String(state !== null);
    this.#tellAwaited(this.#store.drawn.peek());
    if (state) this.#write(state);
  }

  /** Names the surface that the picture waits for. */
  #tellAwaited(wanted: ViewState): void {
    tell(this.#awaited, this.#drawn?.surface === wanted.surface ? "" : awaitedWords(wanted));
  }

  /** Writes what stands on the picture of a state. */
  #write(state: ViewState): void {
    const sphere = this.#shown.envelope_sphere;
    const [width] = this.size(state);
    const { mm_per_pixel } = project(state, sphere, this.size(state));
    const { beside } = state;
    for (const [at, overlay] of [this.#overlay, this.#otherOverlay].entries()) {
      overlay.letter(edgesOf(state.orientation));
      // Where panes show several series, each names its own; the bars name the others.
      const isOwn = Object.keys(state.panes).length > 0 && !state.layer && !state.overlay;
      const badge = beside ? lookWords(at > 0 ? state : beside) : isOwn ? t("value.own") : "";
      overlay.title(titleOf(state, state.orientation), badge);
      overlay.scale(mm_per_pixel, width);
      overlay.divide(state.swipe);
    }
    this.element.classList.toggle("halved", isHalved(state));
    this.element.classList.toggle("stacked", isStacked(state, this.#whole));
    if (!beside) this.#leftBars.remove();
    else if (!this.#leftBars.isConnected) this.element.append(this.#leftBars);
    if (isMirrored(state)) this.#tellSides(state);
    for (const [at, [colours, map]] of this.#bars.entries()) {
      const look = at > 0 ? leftOf(state) : state;
      colours.show(look);
      map.show(look.overlay);
    }
    this.#cube.show(state.orientation);
    Object.assign(this.element.dataset, {
      depth: state.depth_mm,
      surface: state.surface,
      overlay: state.overlay?.name ?? "",
      layer: state.layer?.id ?? "",
      beside: beside ? [beside.layer?.id, beside.overlay?.name].join() : "",
    });
    this.#cross();
  }

  /** Which hemisphere each half shows, and which of them is flipped. */
  #tellSides(state: ViewState): void {
    const sphere = this.#shown.envelope_sphere;
    const plane = this.#shown.midsagittal;
    const side = sideShown(state, plane);
    this.#overlay.title(titleOf(state, state.orientation), t(`mirror.${side}`));
    const edges = edgesOf(mirrored(state, plane, sphere).orientation);
    this.#otherOverlay.letter({ ...edges, left: edges.right, right: edges.left });
    // Of the side that is seen, from however near to its name's direction.
    const { orientation } = mirrored(state, plainPlane(sphere), sphere);
    const other = { ...state, surface: mirroredSurface(state.surface) };
    const words = t(`flipped.${OPPOSITE[side]}`);
    const doubt = this.#shown.midsagittal?.doubtful ? `; ${t("mirror.doubtful")}` : "";
    this.#otherOverlay.title(titleOf(other, orientation), `${words}${doubt}`);
  }

  #onStatus(status: SurfaceStatus): void {
    this.element.classList.toggle("troubled", status.trouble !== "");
    this.#store.trouble.value = status.trouble;
    this.#store.status.value = status;
    // It tells of itself while it is being made.
    if (this.surface) this.#store.meet(this.surface);
  }

  mark(marked: readonly Marked[]): void {
    this.#marked = marked;
    if (this.#drawn) this.#marks(this.#drawn);
  }

  /** The marks on the side of the head that each half shows; those of the picture that is up stay as they are. */
  #marks(state: ViewState): void {
    const sphere = this.#shown.envelope_sphere;
    const size = this.size(state);
    const laid = [state, this.#marked, ...size, devicePixelRatio];
    if (laid.every((one, at) => one === this.#laid[at])) return;
    this.#laid = laid;
    const mirror = isMirrored(state) ? mirrored(state, this.#shown.midsagittal, sphere) : state;
    const [own, others] = [state.surface, isMirrored(state) ? mirroredSurface(state.surface) : state.surface];
    const marksOf = (surface: SurfaceName, view: View): readonly Mark[] =>
      surfaceMarks(this.#marksOn(surface), state.depth_mm, project(view, sphere, size));
    this.#overlay.marks(marksOf(own, state), size);
    const other = isHalved(state) ? marksOf(others, mirror) : [];
    // The other half is flipped.
    const flip = ([x, y]: Vec2): Vec2 => [isMirrored(state) ? size[0] - x : x, y];
    this.#otherOverlay.marks(
      other.map((mark) => ({ ...mark, parts: mark.parts.map((part) => part.map(flip)) })),
      size,
    );
  }

  /** What is marked on a surface: what lies in the other half is not seen on one half, from whichever side. */
  #marksOn(surface: SurfaceName): readonly Marked[] {
    if (!isHalf(surface)) return this.#marked;
    const plane = this.#shown.midsagittal;
    const isOther = (point: Vec3): boolean => sideOf(point, plane) === mirroredSurface(surface);
    return this.#marked.filter(({ points_in_patient }) => !points_in_patient.every(isOther));
  }

  /** The cross on the picture that is up: beside the mirrored one at the same place of both halves. */
  #cross(): void {
    const state = this.#drawn;
    if (!state) return;
    this.#marks(state);
    const size = this.size(state);
    const mirror = isMirrored(state);
    const position = state.crosshair_mm;
    if (!position) {
      this.#overlay.cursor(isHalved(state) ? this.#ghost : null, size, { kind: "ghost" });
      return this.#otherOverlay.cursor(this.#ghost, size, { kind: "ghost" });
    }
    const { pixelOf } = project(state, this.#shown.envelope_sphere, size);
    const [own, reflection] = [pixelOf(position), pixelOf(reflected(position, this.#shown.midsagittal))];
    // Of the two halves the one that has the point in front: the other one has its mirror image.
    const plane = this.#shown.midsagittal;
    const seen = sideSeen(towardsViewer(state.orientation), plane);
    const isOtherHalf = sideOf(position, plane) === mirroredSurface(state.surface);
    const isFarther = seen !== "middle" && reflection[2] > own[2];
    // One half alone shows its own side, also from within.
    const isOther = mirror && (isHalf(state.surface) ? isOtherHalf : isFarther);
    const [x, y] = isOther ? reflection : own;
    const stacked = isStacked(state, this.#whole);
    const place: Vec2 = !isOther ? [x, y] : stacked ? [x, size[1] + y] : [size[0] + x, y];
    const kind = this.#isHidden(position, state, place, isOther) ? "hidden" : "mark";
    const words = (isMarked: boolean): string => (mirror ? t(isMarked ? "mark.marked" : "mark.opposite") : "");
    const mark = { kind, words: words(true), place_mm: state.place_mm ?? 0 } as const;
    const ghost = { kind: "ghost", words: words(false) } as const;
    this.#overlay.cursor([x, y], size, isOther ? ghost : mark);
    this.#otherOverlay.cursor([x, y], size, isOther || !mirror ? mark : ghost);
  }

  /** Whether the surface lies before a position that is at a place of the pane. */
  #isHidden(position: Vec3, state: ViewState, place: Vec2, isOther: boolean): boolean {
    const sphere = this.#shown.envelope_sphere;
    const size = this.size(state);
    const view = isOther ? mirrored(state, this.#shown.midsagittal, sphere) : state;
    const { pixelOf } = project(view, sphere, size);
    const height_mm = pixelOf(position)[2];
    const seen = this.surface.pick(state, ...place);
    if (seen) return Math.abs(pixelOf(seen.position_in_patient)[2] - height_mm) > HIDDEN_MM;
    // Until the surface is known, the far half of the head is behind it.
    return this.surface.probe(position) === null && height_mm < 0;
  }

  // -- Hands

  #hover(event: PointerEvent | null): void {
    const state = this.#drawn;
    const tool = this.#store.tool;
    if (tool) tool.hover(event && event.buttons === 0 ? (this.#at(event)?.position_in_patient ?? null) : null);
    if (!state || !isHalved(state)) return;
    const box = this.element.getBoundingClientRect();
    this.#ghost = event && this.#inHalf([event.clientX - box.left, event.clientY - box.top]);
    if (!state.crosshair_mm) this.#cross();
  }

  /** What is seen where an event is. */
  #at({ clientX, clientY }: MouseEvent): Picked | null {
    const box = this.element.getBoundingClientRect();
    return this.pick([clientX - box.left, clientY - box.top]);
  }

  /** Whose look is seen at a place of the pane. */
  paneAt([x]: Vec2): Place {
    const state = this.#store.view.now;
    return state.beside && x < viewSize(state, this.#whole)[0] ? "left" : "surface";
  }

  /** A place of the pane within its half. */
  #inHalf(place: Vec2): Vec2 {
    const [width, height] = this.size();
    const state = this.#store.view.now;
    if (!isHalved(state)) return place;
    const [x, y] = place;
    if (isStacked(state, this.#whole)) return [x, y >= height ? y - height : y];
    return [x >= width ? x - width : x, y];
  }

  #gestures(): Gestures {
    const store = this.#store;
    const { view } = store;
    return {
      drag: (kind, move, place) => {
        if (kind === "turn") view.change(turn(view.now, move, this.size()));
        else if (kind === "pan") view.change(pan(view.now, this.#shown, move, this.size()));
        else dragTheWindow(store, move, this.paneAt(place));
      },
      pinch: (fingers) => view.change(pinch(view.now, this.#shown, fingers, this.size())),
      wheel: (pixels, notches, place, event) =>
        turnTheWheel(store, [pixels, notches, event], (factor) =>
          view.change(zoomAt(view.now, this.#shown, factor, this.#inHalf(place), this.size())),
        ),
      tap: (place) => {
        const position = store.tool && this.pick(place)?.position_in_patient;
        if (position) store.tool?.add(position, "surface");
      },
      pick: (place) => {
        if (!store.tool) pick(store, place, this.#drawn ?? undefined);
      },
      busy: (isBusy) => {
        store.isMoving.value = isBusy;
      },
    };
  }
}

/** The side of the head that a picture shows as it was acquired. */
const sideShown = ({ surface, orientation }: ViewState, plane: MirrorPlane): SideSeen =>
  isHalf(surface) ? surface : sideSeen(towardsViewer(orientation), plane);

/** Whether a half is seen from its inner side. */
const isInner = ({ surface, orientation }: Pick<ViewState, "surface" | "orientation">): boolean =>
  isHalf(surface) && viewName(orientation) === mirroredSurface(surface);

/** What is being loaded until the surface of a state is here. */
function awaitedWords(state: ViewState): string {
  const { surface } = state;
  if (!isPart(surface)) return "";
  return t(isHalf(surface) && isInner(state) ? `surface.${surface}-inner-awaited` : `surface.${surface}-awaited`);
}

/** Depth, direction and surface, as they stand on a picture. */
function titleOf(state: ViewState, orientation: ViewState["orientation"]): string {
  const { surface } = state;
  const name = viewName(orientation);
  if (surface !== "whole") {
    const isWithin = isInner({ surface, orientation });
    // Beside the mirrored half the hemisphere has a place of its own.
    if (isMirrored(state) && isHalf(surface)) {
      const words = isWithin ? t("surface.inner") : name && name !== surface ? t(`view.${name}`) : "";
      return `${depthWords(state)}  ${words}`.trimEnd();
    }
    const direction = name && name !== surface && !isWithin ? `  ${t(`view.${name}`)}` : "";
    return `${depthWords(state)}${direction}  ${t(isHalf(surface) && isWithin ? `surface.${surface}-inner` : `surface.${surface}-said`)}`;
  }
  // Beside the mirrored half the side has a place of its own.
  const isSaid = isMirrored(state) && (name === "left" || name === "right");
  return `${depthWords(state)}${name && !isSaid ? `  ${t(`view.${name}`)}` : ""}`;
}
