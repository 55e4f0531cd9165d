// One slice with the outline of the cut, its cursor and its control.

import { effect } from "@preact/signals";

import { h, icon, iconButton, setValue } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { coordinate } from "../base/readout.ts";
import { STILL_PIXELS, listen } from "./gestures.ts";
import { thresholdWords, titleWords } from "./overlay.ts";
import { FollowingPicture, type Wish, served } from "../base/picture.ts";
import { reflected } from "../model/midsagittal.ts";
import { outlinesOf, pictureSize, sliceQuery } from "../model/query.ts";
import { wheelZoom } from "../model/controls.ts";
import { type Marked, sliceMarks } from "../model/marks.ts";
import {
  CENTRED,
  followedSlice,
  type Placing,
  type SliceView,
  isFlipped,
  movedSlice,
  pinchedSlice,
  reachOf,
  sliceEdges,
  sliceMmPerPixel,
  slicePixel,
  slicePosition,
  withinReach,
  zoomedSlice,
} from "../model/slice-geometry.ts";
import { type Vec2, type Vec3, add, subtract, PLANES, type Plane } from "../model/space.ts";
import { type Place, type Slot, type ViewState, edgesLayer, isMirrored } from "../model/state.ts";
import { perform } from "../store/commands.ts";
import type { Store } from "../store/store.ts";
import { type AcrossPlane, traceOf, turnTo } from "../model/across.ts";
import type { Placed } from "./screenshot.ts";
import { MOST_PIXELS, MOST_SAVED_PIXELS, type PlacedByHand, type SliceRole, dragTheWindow } from "./slice-parts.ts";
import type { MaskLayer } from "./mask-layer.ts";
import { PlanePane } from "./plane-pane.ts";
import { edgesWords, imageWords } from "./slice-words.ts";
import { Trace } from "./trace.ts";

/** The server's colours of outlines, in their order. */
const OUTLINE_COLOURS = 8;
const STEP_MM = 1;

interface Seen {
  readonly state: ViewState;
  readonly view: SliceView;
}

interface SliceOptions {
  readonly pane: Place;
  readonly number?: string;
  readonly role?: SliceRole | null;
}

export class SlicePane extends PlanePane {
  readonly plane: Plane;
  readonly #picture: FollowingPicture<Seen, HTMLElement>;
  readonly #legend = h("div", { class: "outlines", hidden: true });
  readonly #role: SliceRole | null;
  #mask: MaskLayer | null = null;
  readonly #trace = new Trace((place) => this.#turn(place));
  #across: AcrossPlane | null = null;
  /** The mark that the slice was brought to, or that was put here by a hand. */
  #followed: Vec3 | null = null;
  /** The others in its plane, which follow a mark as it does. */
  siblings: readonly SlicePane[] = [];
  /** What the picture that is up shows. */
  #drawn: Seen | null = null;
  readonly #end: () => void;
  /** The marks that are drawn, and where. */
  #laid: { readonly marked: readonly Marked[]; readonly where: string } | null = null;

  /** `number` distinguishes it from others in its plane. */
  constructor(plane: Plane, store: Store, byHand: PlacedByHand, { pane, number = "", role = null }: SliceOptions) {
    const words = t(`plane.${plane}`);
    const [min, max] = reachOf(store.shown, PLANES[plane].axis);
    const play = iconButton("play", t("cine.play", { plane: words + number }), () =>
      perform(store, { kind: "cine", plane }),
    );
    play.dataset.cine = plane;
    super(store, byHand, {
      name: role ? `${plane}-${role.name}` : `${plane}${number}`,
      classes: role ? `${plane} ${role.name}` : plane,
      label: `${t("slice.label", { plane: words })}${number}`,
      plane: words + number,
      pane,
      zoom: role?.zoom ?? CENTRED.zoom,
      range: { min, max, step: 0.5, "aria-label": t("slice.position", { plane: words + number }) },
      buttons: role ? [] : [play],
    });
    this.element.dataset.plane = plane;
    this.#end = effect(() => {
      const isRunning = store.cine.plane.value === plane;
      play.replaceChildren(icon(isRunning ? "pause" : "play"));
      play.setAttribute("aria-pressed", String(isRunning));
    });
    this.plane = plane;
    this.#role = role;
    this.mapBar.element.before(this.#trace.element, this.#legend);
    this.#picture = new FollowingPicture<Seen, HTMLElement>(
      { put: (image, seen) => this.#put(image, seen), complain: (problem) => this.complain(problem) },
      (wish) => this.#load(wish),
    );
    this.#listen();
  }

  /** Shows the slice through the state's cross, else through the middle of the head. */
  show(state: ViewState): void {
    this.state = state;
    this.#follow(state.crosshair_mm);
    const view = this.#view(state);
    const path = this.#path(state, pictureSize(view.size, devicePixelRatio, MOST_PIXELS));
    // The server is not asked for what follows a "#"; what it drew is drawn again once the page can, also divided.
    const { moved } = state.layer ?? state.overlay ?? {};
    const own = [state.swipe?.share, state.has_edges, moved, this.store.surface?.canSlice(state) ?? false];
    // The convention and the cross are the page's own: they need no other picture.
    if (this.#picture.show(`${path}#${own.join()}`, { state, view })) this.#drawn = { state, view };
    setValue(this.range, view.position_mm);
    this.write();
    this.sayHovered();
  }

  /** The slice drawn by the page if it can, else by the server. */
  async #load({ path, about: { state, view } }: Wish<Seen>): Promise<HTMLElement> {
    const drawn = await this.#draw(state, view);
    const label = t("slice.alt", {
      plane: t(`plane.${this.plane}`),
      position: number(view.position_mm, 1),
      depth: number(state.depth_mm, 1),
    });
    if (!drawn) return Object.assign(await served({ path }), { alt: label });
    drawn.setAttribute("aria-label", label);
    return drawn;
  }

  async #draw(state: ViewState, view: SliceView): Promise<HTMLCanvasElement | null> {
    const drawn = await this.store.surface?.slice(state, view, this.outlined ? outlinesOf(state) : []);
    if (!drawn) return null;
    const { width, height } = drawn;
    const canvas = h("canvas", { width, height, role: "img" });
    canvas.getContext("2d")?.putImageData(drawn, 0, 0);
    return canvas;
  }

  /** The slice as it lies in its pane, with so many pixels to a CSS pixel, for a screenshot. */
  async placed(ratio: number): Promise<Placed | null> {
    const state = this.state;
    if (!state) return null;
    const view = this.#view(state);
    const path = this.#path(state, pictureSize(view.size, ratio, MOST_SAVED_PIXELS));
    // In more pixels it is the server's; but that draws no edges, and no layer where the hand has moved it.
    const isOwn = ratio === devicePixelRatio || this.element.dataset.edges || (state.layer ?? state.overlay)?.moved;
    const own = isOwn ? await this.#draw({ ...state, swipe: null }, view) : null;
    const picture = own ?? (await served({ path }));
    return { element: this.frame, picture, isFlipped: isFlipped(this.plane, state.convention) };
  }

  /** Where the picture of a slice of so many pixels is. */
  #path(state: ViewState, size: Vec2): string {
    return this.path(this.plane, sliceQuery(state, this.plane, this.#center(state), size));
  }

  /** The whole slice in the middle again. */
  center(): void {
    const state = this.state;
    const mark = this.#role && state?.crosshair_mm;
    if (!state || !mark || this.frame.clientWidth === 0) return this.setPlacing(this.home);
    this.setPlacing(followedSlice({ ...this.#view(state), placing: this.home }, this.shown, mark));
  }

  /** Lays the outline of a mask over the slice, below what is written on it; null: none. */
  lay(mask: MaskLayer | null): void {
    this.#mask?.element.remove();
    this.#mask = mask;
    if (mask) this.overlay.element.prepend(mask.element);
    if (this.state) this.show(this.state);
  }

  dispose(): void {
    this.#end();
    this.#picture.stop();
  }

  #center(state: ViewState): Vec3 {
    return state.crosshair_mm ?? this.shown.envelope_sphere.center_in_patient;
  }

  #view(state: ViewState): SliceView {
    return {
      plane: this.plane,
      convention: state.convention,
      position_mm: this.#center(state)[PLANES[this.plane].axis],
      size: this.size,
      placing: this.placing,
    };
  }

  #put(image: HTMLElement, seen: Seen): void {
    const { state, view } = seen;
    this.#drawn = seen;
    const isOwn = image instanceof HTMLCanvasElement;
    const edges = isOwn && edgesLayer(state);
    this.put(image, {
      way: isOwn ? "page" : "server",
      position: view.position_mm,
      depth: state.depth_mm,
      overlay: state.overlay?.name ?? "",
      layer: state.layer?.id ?? "",
      edges: edges ? edges.name : "",
      moved: String((state.layer ?? state.overlay)?.moved ?? ""),
    });
    this.mapBar.show(edges ? null : state.overlay);
    this.overlay.divide(isOwn ? state.swipe : null);
    this.write();
  }

  /** What is seen: the plane of the picture that is up, as the pane lies now. */
  #seen(state: ViewState): Seen {
    const view = this.#view(state);
    const drawn = this.#drawn;
    return drawn
      ? { state: drawn.state, view: { ...drawn.view, size: view.size, placing: view.placing } }
      : { state, view };
  }

  /** Words, marks and the cross are of the picture that is up: the one of another state may come later. */
  protected write(): void {
    if (!this.state) return;
    const sphere = this.shown.envelope_sphere;
    const { state, view } = this.#seen(this.state);
    const drawn = this.#drawn;
    if (drawn) this.lie(drawn.view, view);
    this.image.classList.toggle("flipped", isFlipped(this.plane, state.convention));
    this.overlay.letter(sliceEdges(this.plane, state.convention));
    const { position_mm } = view;
    const marked = state.crosshair_mm;
    const place = `${coordinate(position_mm, PLANES[this.plane].axis)} mm`;
    const { edges } = this.element.dataset;
    const layer = this.#role ? state.layer?.about?.title : state.layer && titleWords(state.layer.about);
    // Where panes show several series, each names its own.
    const isOwn = this.#role ? !this.#role.isLayer : Object.keys(state.panes).length > 0 && !state.overlay;
    const own = isOwn ? t("value.own") : "";
    const image = layer && !edges ? layer : own || imageWords(this.shown, this.plane, this.#center(state));
    const over =
      (this.#role?.isLayer || state.panes[this.pane as Slot]) && state.overlay && !edges
        ? thresholdWords(state.overlay)
        : "";
    const convention = this.plane === "sagittal" ? "" : t(`convention.${state.convention}.badge`);
    const badge = this.#role ? this.#role.words(this.#center(state)) : convention;
    const more = [image, over, edges && edgesWords(state, this.isLarge)].filter(Boolean).join(" · ");
    // Two lines, so that the picture keeps its size.
    this.overlay.title(`${t(`plane.${this.plane}`)}${more ? " " : "\n"}${place}\n${more}`, badge);
    this.overlay.scale(sliceMmPerPixel(view, sphere), view.size[0]);
    const twin = this.#twin(state, view, marked);
    const words = twin ? t("mark.marked") : "";
    const cross = marked && slicePixel(view, sphere, marked);
    const kind = this.#role?.isOpposite ? "ghost" : "mark";
    this.overlay.cursor(cross, view.size, { kind, words, place_mm: state.place_mm ?? 0 });
    this.overlay.twin(twin, view.size);
    this.#showMarks(view);
    this.#showTrace(view);
    this.#mask?.show(view, sphere, this.outlined);
    this.#explain(state);
    this.range.setAttribute("aria-valuetext", `${place} ${more}`);
    if (!this.#role) return;
    const label = t("slice.label", { plane: t(`plane.${this.plane}`) });
    this.element.setAttribute("aria-label", [label, badge, more].filter(Boolean).join(", "));
  }

  /** The marks in the slice: a turn of the head leaves them as they are. */
  #showMarks(view: SliceView): void {
    const where = JSON.stringify([view, devicePixelRatio]);
    if (this.#laid?.marked === this.marked && this.#laid.where === where) return;
    this.#laid = { marked: this.marked, where };
    const { axis } = PLANES[this.plane];
    const away = (point: Vec3): number => point[axis] - view.position_mm;
    const placeOf = (point: Vec3): Vec2 => slicePixel(view, this.shown.envelope_sphere, point);
    this.overlay.marks(sliceMarks(this.marked, away, placeOf), view.size);
  }

  /** Where the mirror image of the marked point is: beside the mirrored half, and not across the plane between them. */
  #twin(state: ViewState, view: SliceView, marked: Vec3 | null): Vec2 | null {
    if (!marked || !isMirrored(state) || this.plane === "sagittal") return null;
    return slicePixel(view, this.shown.envelope_sphere, reflected(marked, this.shown.midsagittal));
  }

  /** Shows how the slice across the sulcus crosses this one; null: it does not. */
  trace(plane: AcrossPlane | null): void {
    this.#across = plane;
    if (this.state) this.#showTrace(this.#seen(this.state).view);
  }

  #showTrace(view: SliceView): void {
    const [plane, sphere] = [this.#across, this.shown.envelope_sphere];
    const along = plane && traceOf(plane, PLANES[this.plane].axis);
    if (!along) return this.#trace.show(null, null, view.size);
    const [here, there] = [plane.mark, add(plane.mark, along)].map((point) => slicePixel(view, sphere, point));
    if (here && there) this.#trace.show(here, [there[0] - here[0], there[1] - here[1]], view.size);
  }

  /** The handle of the trace is dragged to a place: the plane holds it then. */
  #turn(place: Vec2): void {
    const [plane, state] = [this.#across, this.state];
    if (!plane || !state) return;
    const position = slicePosition(this.#seen(state).view, this.shown.envelope_sphere, place);
    const turn_deg = turnTo(plane, subtract(position, plane.mark));
    if (turn_deg !== null) this.store.view.change({ across_deg: turn_deg });
  }

  /** Lists the depths of the outlines with their colours, if there are several. */
  #explain(state: ViewState): void {
    const depths = outlinesOf(state);
    this.#legend.hidden = depths.length < 2 || !this.outlined;
    const words = depths.map((depth) => `${number(depth, depth % 1 === 0 ? 0 : 1)} mm`);
    this.#legend.replaceChildren(
      ...words.map((text, at) => h("span", { class: `outline-${at % OUTLINE_COLOURS}` }, text)),
    );
  }

  protected slide(position_mm: number): void {
    if (!this.state) return;
    const position = this.#center(this.state).map((value, axis) =>
      axis === PLANES[this.plane].axis ? position_mm : value,
    );
    const within = withinReach(this.shown, position as unknown as Vec3);
    this.#stay(within);
    if (this.#role) this.#role.scroll(within);
    else this.store.moveCross(within, false);
  }

  /** A hand puts the mark here: the slice stays as it lies. */
  #move(position: Vec3, done: boolean): void {
    this.#stay(position);
    if (this.#role) this.#role.move(position, done);
    else this.store.moveCross(position, done);
  }

  /** Slices in one plane lie alike: a hand that marks in one of them moves none. */
  #stay(mark: Vec3): void {
    for (const one of [this, ...this.siblings]) one.#followed = mark;
  }

  #step(steps: number): void {
    if (this.state) this.slide(this.#center(this.state)[PLANES[this.plane].axis] + steps * STEP_MM);
  }

  /** A mark that was put elsewhere is brought into the middle. */
  #follow(mark: Vec3 | null): void {
    if (mark === this.#followed || !this.state || this.frame.clientWidth === 0) return;
    this.#followed = mark;
    if (mark) this.placing = followedSlice(this.#view(this.state), this.shown, mark);
  }

  /** Lies as another one in its plane does. */
  lieAs(placing: Placing): void {
    const { zoom, pan_mm } = this.placing;
    if (zoom !== placing.zoom || pan_mm.some((one, at) => one !== placing.pan_mm[at])) this.setPlacing(placing);
  }

  /** Enlarges the slice as another one was: about the mark if there is one, else about its middle. */
  zoomTo(zoom: number): void {
    if (zoom === this.placing.zoom) return;
    if (!this.state) {
      this.placing = { ...this.placing, zoom };
      return;
    }
    const view = this.#view(this.state);
    const middle: Vec2 = [view.size[0] / 2, view.size[1] / 2];
    const { crosshair_mm } = this.state;
    const about = crosshair_mm ? slicePixel(view, this.shown.envelope_sphere, crosshair_mm) : middle;
    const placing = zoomedSlice(view, this.shown, zoom / this.placing.zoom, about);
    this.setPlacing(crosshair_mm ? followedSlice({ ...view, placing }, this.shown, crosshair_mm) : placing);
  }

  protected positionAt(at: Vec2): Vec3 | null {
    if (!this.state) return null;
    return withinReach(this.shown, slicePosition(this.#seen(this.state).view, this.shown.envelope_sphere, at));
  }

  #listen(): void {
    let at: Vec2 | null = null;
    let mayScroll = false;
    let marked: Vec3 | null = null;
    // A hand that leaves the head leaves the cross where it was last.
    const cross = (place: Vec2, done: boolean): void => {
      const position = this.positionAt(place);
      if (position && this.store.surface?.isInHead(position)) marked = position;
      if (marked) this.#move(marked, done);
      else if (done) this.store.miss(t("point.beside"));
    };
    /** Points are set where a mouse comes down, and where it or a finger leaves after a drag: fingers also scroll. */
    const set = (place: Vec2): boolean => {
      const tool = this.store.tool;
      const position = tool && this.positionAt(place);
      if (position) tool.add(position, "slice");
      return tool !== null;
    };
    let pressed: Vec2 = [0, 0];
    let pulled: Vec2 | null = null;
    listen(
      this.frame,
      {
        press: (kind, place, isFinger) => {
          pressed = place;
          pulled = null;
          if (kind === "turn" && this.store.tool) {
            if (isFinger) pulled = place;
            else set(place);
            return;
          }
          at = kind === "turn" ? place : null;
          marked = null;
          mayScroll = isFinger;
          if (at && !isFinger) cross(at, false);
        },
        cancel: () => (at = pulled = null),
        drag: (kind, move, place) => {
          if (kind === "window") return dragTheWindow(this.store, move, this.pane);
          if (kind === "pan") {
            if (this.state) this.place(movedSlice(this.#view(this.state), this.shown, move));
            return;
          }
          const tool = this.store.tool;
          if (tool) {
            // A hand that clicks may tremble.
            if (Math.hypot(place[0] - pressed[0], place[1] - pressed[1]) > STILL_PIXELS) pulled = place;
            return tool.hover(this.positionAt(place));
          }
          at = place;
          // A finger that goes up or down may be taken away to scroll the page.
          mayScroll &&= Math.abs(move[1]) >= Math.abs(move[0]);
          if (!mayScroll) cross(place, false);
        },
        pinch: (fingers) => {
          at = pulled = null;
          if (this.state) this.place(pinchedSlice(this.#view(this.state), this.shown, fingers));
        },
        wheel: (pixels, notches, place, event) => {
          // A pinch on a touchpad comes as a wheel with the control key.
          if (event.ctrlKey && this.state) {
            this.place(zoomedSlice(this.#view(this.state), this.shown, wheelZoom(pixels * 2), place));
          } else if (!event.ctrlKey && notches !== 0) {
            // Away from the user is towards the top, the back and the left of the head, as the numbers grow on a slider.
            this.#step(-notches);
          }
        },
        pick: () => {
          if (!this.store.tool) this.store.enlarge(this.name, true);
        },
        busy: (busy) => {
          if (!busy && pulled) set(pulled);
          pulled = null;
          if (busy) return;
          if (at) cross(at, true);
          // A second finger, or the system, ends what a hand has begun.
          else if (marked) this.#move(marked, true);
          at = marked = null;
        },
      },
      this.store.moves,
    );
    this.element.addEventListener("keydown", (event) => {
      if (event.target !== this.element || event.ctrlKey || event.metaKey || event.altKey) return;
      const tool = this.store.tool;
      if (event.key === "Enter" && tool && this.state) {
        tool.add(this.#center(this.state), "slice");
        event.preventDefault();
        return;
      }
      if (event.key === "Home") {
        this.center();
        this.byHand(this.name, this.placing, true);
        event.preventDefault();
        return;
      }
      const steps = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1, PageUp: 10, PageDown: -10 }[event.key];
      if (steps === undefined) return;
      this.#step(steps);
      event.preventDefault();
      event.stopPropagation();
    });
  }
}
