// The pane of the flat map: the discs of both hemispheres, and what stands on them.

import { Problem, getPositions } from "../base/api.ts";
import { caseIdentity } from "../base/case-words.ts";
import { h, setText, svg } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { FollowingPicture, type Wish, served } from "../base/picture.ts";
import { problemWords } from "../base/problem-words.ts";
import { depthWords } from "../base/readout.ts";
import { LETTERS, towardsViewer } from "../model/camera.ts";
import type { ReadyCase } from "../model/case.ts";
import { panMap, pinched, zoomMap } from "../model/controls.ts";
import {
  type Centres,
  type DiscProjection,
  FIRST_MAP,
  MAP_MARGIN,
  MAP_RIM,
  type MapPositions,
  curvesOf,
  discAt,
  discsOf,
  mapExtent,
  multiples,
  nearestPlace,
  pixelsPerUnit,
  placeOnMap,
  projectDisc,
  radiusAt,
  scaleAt,
  shownAt,
  single,
  surfaceOf,
} from "../model/flat-map.ts";
import { ARROWS } from "../model/keys.ts";
import { type Marked, surfaceMarks } from "../model/marks.ts";
import { mapQuery, pictureSize } from "../model/query.ts";
import { type Vec2, type Vec3, add, clamp, dot, scale, distance, PLANES, PLANE_NAMES } from "../model/space.ts";
import { type ViewState, LOOK_KEYS, stateIn } from "../model/state.ts";
import type { Store } from "../store/store.ts";
import { listen } from "./gestures.ts";
import { MapBar } from "./map-bar.ts";
import { Overlay, titleWords } from "./overlay.ts";
import type { Placed } from "./screenshot.ts";
import { dragTheWindow, turnTheWheel } from "./slice-parts.ts";

/** CSS pixels from one known position to the next. */
const STEP = 2;
const MOST_PIXELS = 1600;
const MOST_SAVED_PIXELS = 4096;
/** How long the map must rest before its positions are fetched, in ms. */
const REST_MS = 150;
const GRATICULE_MM = 20;
/** The diameter of the disc under the pointer, in mm. */
const DISC_MM = 10;
/** A marked point that lies farther than this from what its place shows is not on the map. */
const HIDDEN_MM = 3;
/** So far the letter of a side stands from the border between the discs, in CSS pixels. */
const SIDE_GAP = 16;
/** Longer than any way through a head. */
const REACH_MM = 400;

function letterOf(direction: Vec3): string {
  const sizes = direction.map(Math.abs);
  const axis = sizes.indexOf(Math.max(...sizes));
  return LETTERS[axis]?.[(direction[axis] ?? 0) > 0 ? 0 : 1] ?? "";
}

interface Seen {
  readonly state: ViewState;
  /** In CSS pixels. */
  readonly size: Vec2;
}

export class MapPane {
  readonly element: HTMLElement;
  readonly #shown: ReadyCase;
  readonly #store: Store;
  readonly #image = h("div", { class: "map-image" });
  readonly #lines = svg("svg", { class: "map-lines", "aria-hidden": "true" });
  readonly #curves = svg("g");
  readonly #letters = svg("g");
  readonly #looking = svg("circle", { class: "looking", r: 9 });
  readonly #disc = svg("circle", { class: "scale-disc", hidden: true });
  readonly #overlay: Overlay;
  readonly #bar = new MapBar();
  readonly #scale = h("span", { class: "map-scale" });
  readonly #faces = h("span", { class: "faces" }, t("flat-map.faces"));
  /** What the lines through the mark are, and the broken circle. */
  readonly #legend = h(
    "div",
    { class: "map-legend" },
    ...PLANE_NAMES.map((plane) => h("span", { class: plane }, t(`plane.${plane}`))),
    this.#faces,
  );
  readonly #inner = h("button", { type: "button", class: "map-inner", click: () => this.#toggleInner() });
  readonly #keys = h("p", { id: "map-keys", class: "visually-hidden" });
  readonly #picture: FollowingPicture<Seen, HTMLElement>;
  #state: ViewState | null = null;
  /** What the picture that is up shows. */
  #seen: Seen | null = null;
  #marked: readonly Marked[] = [];
  #positions: MapPositions | null = null;
  #drawn: readonly [MapPositions | null, Vec3 | null] = [null, null];
  /** What the positions are of. */
  #known = "";
  #asking: AbortController | null = null;
  #timer = 0;
  #pointer: Vec2 | null = null;

  constructor(store: Store) {
    const { shown } = store;
    this.#shown = shown;
    this.#store = store;
    this.element = h(
      "section",
      {
        class: "pane flat-map blank",
        id: "flat-map",
        role: "application",
        tabindex: 0,
        "aria-label": t("flat-map.label"),
        "aria-describedby": "map-keys",
        "data-pane": "map",
        keydown: (event: KeyboardEvent) => this.#onKey(event),
      },
      this.#image,
    );
    this.#overlay = new Overlay(this.element);
    this.#overlay.identity(caseIdentity(shown));
    this.#lines.append(this.#curves, this.#letters, this.#looking, this.#disc);
    this.#overlay.element.prepend(this.#lines);
    this.#scale.title = t("flat-map.about");
    this.element.append(this.#bar.element, this.#scale, this.#legend, this.#inner, this.#keys);
    this.#picture = new FollowingPicture<Seen, HTMLElement>(
      { put: (image, seen) => this.#put(image, seen), complain: (problem) => this.#complain(problem) },
      (wish) => this.#load(wish),
    );
    this.#listen();
  }

  show(shown: ViewState): void {
    // The outer discs show both hemispheres, and the inner ones theirs, whichever surface the other pane shows.
    const state: ViewState = { ...stateIn(shown, "map"), surface: "whole" };
    this.#state = state;
    const size = this.#size;
    if (size[0] < STEP || size[1] < STEP) return;
    const { surface } = this.#store;
    const { moved } = state.layer ?? state.overlay ?? {};
    const path = this.#path(state, this.#pixels(devicePixelRatio, MOST_PIXELS));
    // What lies on the map, as the cross, needs no other picture.
    if (this.#picture.show(`${path}#${[moved, surface?.canMap(state) ?? false].join()}`, { state, size }))
      this.#seen = { state, size };
    this.#askForPositions(this.#seen ?? { state, size });
    setText(this.#inner, t(state.map.has_inner ? "flat-map.without-inner" : "flat-map.with-inner"));
    this.#inner.setAttribute("aria-pressed", String(state.map.has_inner));
    this.#write();
  }

  mark(marked: readonly Marked[]): void {
    this.#marked = marked;
    this.#write();
  }

  describe(words: string): void {
    setText(this.#keys, `${words} ${t("flat-map.keys")}`);
  }

  /** The map as it lies in its pane, with so many pixels to a CSS pixel, for a screenshot. */
  async pictures(ratio: number): Promise<readonly Placed[]> {
    const state = this.#state;
    if (!state) return [];
    const pixels = this.#pixels(ratio, MOST_SAVED_PIXELS);
    const picture = (await this.#draw(state, pixels)) ?? (await served({ path: this.#path(state, pixels) }));
    return [{ element: this.#image, picture, isFlipped: false }];
  }

  dispose(): void {
    this.#picture.stop();
    clearTimeout(this.#timer);
    this.#asking?.abort();
    this.element.remove();
  }

  // -- The picture

  /** Of which each position that is known is the middle of a square of as many pixels. */
  get #size(): Vec2 {
    const whole = (side: number): number => Math.floor(side / STEP) * STEP;
    return [whole(this.element.clientWidth), whole(this.element.clientHeight)];
  }

  #pixels(ratio: number, most: number): Vec2 {
    return pictureSize(this.#size, ratio, most);
  }

  #path(state: ViewState, size: Vec2): string {
    return `${this.#shown.id}/render?${mapQuery(state, size)}`;
  }

  async #load({ path, about }: Wish<Seen>): Promise<HTMLElement> {
    const drawn = await this.#draw(about.state, this.#pixels(this.#ratio, MOST_SAVED_PIXELS));
    return drawn ?? Object.assign(await served({ path }), { alt: t("flat-map.label") });
  }

  /** Pixels to a CSS pixel where the page draws. */
  get #ratio(): number {
    return Math.min(devicePixelRatio, 2);
  }

  async #draw(state: ViewState, size: Vec2): Promise<HTMLCanvasElement | null> {
    const drawn = (await this.#store.surface?.map(state, size)) ?? null;
    if (!drawn) return null;
    const canvas = h("canvas", {
      width: drawn.width,
      height: drawn.height,
      role: "img",
      "aria-label": t("flat-map.label"),
    });
    canvas.getContext("2d")?.putImageData(drawn, 0, 0);
    return canvas;
  }

  #put(image: HTMLElement, seen: Seen): void {
    this.#seen = seen;
    this.element.classList.remove("blank");
    const { state } = seen;
    const [width, height] = seen.size;
    Object.assign(this.#image.style, { width: `${width}px`, height: `${height}px` });
    this.#image.replaceChildren(image);
    this.#bar.show(state.overlay);
    Object.assign(this.element.dataset, {
      way: image instanceof HTMLCanvasElement ? "page" : "server",
      depth: state.depth_mm,
      inner: state.map.has_inner,
      overlay: state.overlay?.name ?? "",
      layer: state.layer?.id ?? "",
    });
    this.#askForPositions(seen);
    this.#write();
  }

  #complain(problem: unknown): void {
    const state = this.#state;
    // Without surfaces of its halves, a head has no inner sides.
    if (problem instanceof Problem && problem.kind === "no-surfaces" && state?.map.has_inner) {
      this.#store.view.change({ map: { ...state.map, has_inner: false } });
      return void (this.#store.remark.value = problemWords(problem));
    }
    this.element.classList.toggle("troubled", problem !== null);
    this.#store.complain(problem);
  }

  // -- What it shows where

  /** Fetches the positions of a map that rests. */
  #askForPositions({ state, size: [width, height] }: Seen): void {
    const query = mapQuery({ ...state, layer: null, overlay: null }, [width / STEP, height / STEP]);
    // What it looks like has no influence on what is seen where.
    for (const key of ["window", "colormap", ...LOOK_KEYS]) query.delete(key);
    const wanted = `${this.#shown.id}/render?${query}`;
    if (wanted === this.#known) return;
    this.#known = wanted;
    this.#positions = null;
    this.#asking?.abort();
    clearTimeout(this.#timer);
    this.#timer = window.setTimeout(() => void this.#fetch(wanted), REST_MS);
  }

  async #fetch(path: string): Promise<void> {
    this.#asking = new AbortController();
    const { signal } = this.#asking;
    try {
      const { xyz, size } = await getPositions(path, signal);
      if (signal.aborted) return;
      this.#positions = { xyz, size, step: STEP };
      this.element.dataset.known = path.split("?")[1] ?? "";
      this.#write();
    } catch {
      // The picture complains of a server that does not answer.
      if (!signal.aborted) this.#known = "";
    }
  }

  /** The middles of the hemispheres; until the page knows them, that of the head, with which the discs have their places. */
  get #centres(): Centres {
    const { center_in_patient: middle } = this.#shown.envelope_sphere;
    return this.#store.surface?.centres ?? { left: middle, right: middle };
  }

  #discs({ state, size }: Seen): readonly DiscProjection[] {
    const discs = discsOf(this.#centres, this.#shown.midsagittal, state.map.has_inner);
    return discs.map((disc) => projectDisc(disc, state.map, size));
  }

  /** The position that is shown at a place: exactly, where the page knows the surface. */
  #positionAt(place: Vec2): Vec3 | null {
    const seen = this.#seen;
    if (!seen) return null;
    const disc = discAt(this.#discs(seen), place);
    const { surface } = this.#store;
    const points = disc && surface?.centres && surface.pointsOf(surfaceOf(disc.disc));
    const direction = disc?.directionAt(place);
    if (!points || !direction) return this.#positions && shownAt(this.#positions, place);
    const from = add(disc.disc.center_in_patient, scale(direction, REACH_MM));
    return points.met({ from, direction: scale(direction, -1), reach_mm: REACH_MM }, seen.state.depth_mm);
  }

  // -- What stands on it

  /** Words, lines and marks are of the picture that is up: the one of another state may come later. */
  #write(): void {
    const seen = this.#seen ?? (this.#state && { state: this.#state, size: this.#size });
    if (!seen) return;
    const { state, size } = seen;
    const discs = this.#discs(seen);
    this.#overlay.scale(this.#shown.envelope_sphere.radius_mm / this.#unit(state), size[0]);
    const layer = state.layer ? ` · ${titleWords(state.layer.about)}` : "";
    this.#overlay.title(`${t("layout.map")} · ${depthWords(state)}${layer}`);
    this.#lines.setAttribute("viewBox", `0 0 ${size[0]} ${size[1]}`);
    Object.assign(this.#lines.style, { width: `${size[0]}px`, height: `${size[1]}px` });
    this.#letters.replaceChildren(...discs.flatMap((disc) => this.#lettersOf(disc, size)));
    this.#drawCurves(state, discs);
    for (const plane of PLANE_NAMES)
      this.#legend.querySelector(`.${plane}`)?.toggleAttribute("hidden", state.crosshair_mm === null);
    this.#showLooking(state, discs);
    const isKnown = (this.#store.surface?.centres ?? null) !== null;
    const marks = (isKnown ? discs : []).flatMap((disc) =>
      surfaceMarks(this.#marked, state.depth_mm, { pixelOf: onDisc(disc, discs, this.#shown) }),
    );
    this.#overlay.marks(marks, size);
    this.#showCross(seen, discs, isKnown);
    this.#showDisc();
  }

  #showCross({ state, size }: Seen, discs: readonly DiscProjection[], isKnown: boolean): void {
    const { crosshair_mm: marked } = state;
    const positions = this.#positions;
    const projected = marked && isKnown ? (placeOnMap(discs, this.#shown.midsagittal, marked)?.place ?? null) : null;
    const place = projected ?? (marked && positions && nearestPlace(positions, marked, 2 * HIDDEN_MM));
    const seen = place && positions ? shownAt(positions, place) : null;
    const isHidden = seen && marked && distance(seen, marked) > HIDDEN_MM;
    this.#overlay.cursor(place, size, { kind: isHidden ? "hidden" : "mark" });
  }

  #lettersOf(disc: DiscProjection, [width, height]: Vec2): readonly SVGElement[] {
    const { center, pixels_per_unit, disc: about } = disc;
    const [right, up] = about.axes;
    const away = ((MAP_RIM + MAP_MARGIN) / 2) * pixels_per_unit;
    const at = (words: string, x: number, y: number, name: string): SVGElement => {
      const text = svg("text", { x, y, class: name });
      text.textContent = words;
      return text;
    };
    const [x, y] = center;
    const rim = [
      at(letterOf(right), x + away, y, "rim"),
      at(letterOf(scale(right, -1)), x - away, y, "rim"),
      at(letterOf(up), x, y - away, "rim"),
      at(letterOf(scale(up, -1)), x, y + away, "rim"),
    ];
    const reach = MAP_MARGIN * pixels_per_unit;
    if (x + reach < 0 || x - reach > width || y + reach < 0 || y - reach > height) return rim;
    const isLeft = about.hemisphere === "left";
    const side = isLeft ? "end" : "start";
    // At the upper corner towards the middle of the map, apart from the letter of the other side, or within the pane.
    const corner = clamp(isLeft ? x + reach - SIDE_GAP : x - reach + SIDE_GAP, 8, width - 8);
    const top = clamp(y - reach, 4, height - 40);
    const letters = [...rim, at(isLeft ? "L" : "R", corner, top + 26, `side ${side}`)];
    return about.face === "inner" ? [...letters, at(t("flat-map.inner"), corner, top + 42, `inner ${side}`)] : letters;
  }

  #drawCurves({ crosshair_mm }: ViewState, discs: readonly DiscProjection[]): void {
    const positions = this.#positions;
    if (positions === this.#drawn[0] && crosshair_mm === this.#drawn[1]) return;
    this.#drawn = [positions, crosshair_mm];
    if (!positions) return this.#curves.replaceChildren();
    const isWithin = (place: Vec2): boolean => discs.some((disc) => radiusAt(disc, place) < MAP_RIM);
    const path = (axis: 0 | 1 | 2, levels: Parameters<typeof curvesOf>[2], name: string): SVGElement => {
      const pieces = curvesOf(positions, axis, levels, isWithin);
      const d = pieces
        .map((ends) =>
          ends
            .map((end) => end.toFixed(1))
            .join(" ")
            .replace(/^(\S+ \S+) /, "M$1L"),
        )
        .join("");
      return svg("path", { d, class: name });
    };
    const levels = multiples(GRATICULE_MM);
    const graticule = [path(1, levels, "graticule"), path(2, levels, "graticule")];
    const planes = crosshair_mm
      ? PLANE_NAMES.map((plane) => path(PLANES[plane].axis, single(crosshair_mm[PLANES[plane].axis]), plane))
      : [];
    this.#curves.replaceChildren(...graticule, ...planes);
  }

  /** Where the other pane looks: what faces the viewer there. */
  #showLooking({ orientation }: ViewState, discs: readonly DiscProjection[]): void {
    const towards = towardsViewer(orientation);
    const { normal } = this.#shown.midsagittal;
    const isLeft = dot(normal, towards) >= 0;
    const disc = discs.find(({ disc: { hemisphere, face } }) => face === "outer" && (hemisphere === "left") === isLeft);
    const position = disc && add(disc.disc.center_in_patient, towards);
    const place = position && disc.placeOf(position);
    this.#looking.toggleAttribute("hidden", !place);
    this.#faces.hidden = !place;
    if (!place) return;
    this.#looking.setAttribute("cx", place[0].toFixed(1));
    this.#looking.setAttribute("cy", place[1].toFixed(1));
    this.element.dataset.looking = isLeft ? "left" : "right";
  }

  /** A disc of 10 mm under the pointer, with the scale there. */
  #showDisc(): void {
    const place = this.#pointer;
    const mm_per_pixel = place && this.#positions && scaleAt(this.#positions, place);
    this.#disc.toggleAttribute("hidden", !mm_per_pixel);
    if (!place || !mm_per_pixel) return setText(this.#scale, place && this.#positions ? t("flat-map.no-scale") : "");
    this.#disc.setAttribute("cx", place[0].toFixed(1));
    this.#disc.setAttribute("cy", place[1].toFixed(1));
    this.#disc.setAttribute("r", (DISC_MM / 2 / mm_per_pixel).toFixed(1));
    setText(this.#scale, t("flat-map.scale", { mm: number(100 * mm_per_pixel, 0) }));
  }

  // -- Hands and keys

  #toggleInner(): void {
    const state = this.#state;
    if (state) this.#change({ map: { ...state.map, has_inner: !state.map.has_inner } });
  }

  /** Changes what the map shows, at once: the next key may come before the next frame. */
  #change(change: Pick<ViewState, "map">): void {
    if (this.#state) this.#state = { ...this.#state, ...change };
    this.#store.view.change(change);
  }

  /** Pixels of the radius of the sphere. */
  #unit(state: ViewState): number {
    return pixelsPerUnit(mapExtent(state.map), state.map, this.#size);
  }

  #pan(move: Vec2): void {
    if (this.#state) this.#change(panMap(this.#state, move, this.#unit(this.#state)));
  }

  #zoom(factor: number, place: Vec2): void {
    const [width, height] = this.#size;
    const away: Vec2 = [place[0] - width / 2, place[1] - height / 2];
    if (this.#state) this.#change(zoomMap(this.#state, factor, away, this.#unit(this.#state)));
  }

  #pick(place: Vec2): void {
    const position = this.#positionAt(place);
    if (!position) return this.#store.miss(t("point.none"));
    const tool = this.#store.tool;
    if (tool) tool.add(position, "surface");
    else this.#store.moveCross(position, true);
  }

  #listen(): void {
    const store = this.#store;
    listen(
      this.element,
      {
        drag: (kind, move) => {
          if (kind === "window") dragTheWindow(store, move, "map");
          else this.#pan(move);
        },
        pinch: (fingers) => {
          const { factor, about, move } = pinched(fingers);
          this.#zoom(factor, about);
          this.#pan(move);
        },
        wheel: (pixels, notches, place, event) =>
          turnTheWheel(store, [pixels, notches, event], (factor) => this.#zoom(factor, place)),
        tap: (place) => this.#pick(place),
        pick: () => {},
        busy: (isBusy) => {
          store.isMoving.value = isBusy;
        },
      },
      store.moves,
    );
    this.element.addEventListener("pointermove", (event) => this.#hover(event));
    this.element.addEventListener("pointerleave", () => this.#hover(null));
  }

  #hover(event: PointerEvent | null): void {
    const { left, top } = this.element.getBoundingClientRect();
    this.#pointer = event && event.buttons === 0 ? [event.clientX - left, event.clientY - top] : null;
    const tool = this.#store.tool;
    if (tool) tool.hover(this.#pointer && this.#positionAt(this.#pointer));
    this.#showDisc();
  }

  /** Its own keys, while it has the focus. */
  #onKey(event: KeyboardEvent): void {
    if (event.target !== this.element || event.ctrlKey || event.metaKey || event.altKey) return;
    const middle: Vec2 = [this.#size[0] / 2, this.#size[1] / 2];
    const arrow = ARROWS[event.key];
    if (arrow) this.#pan(arrow);
    else if (event.key === "+" || event.key === "=") this.#zoom(1.2, middle);
    else if (event.key === "-") this.#zoom(1 / 1.2, middle);
    else if (event.key === "Home" && this.#state)
      this.#change({ map: { ...FIRST_MAP, has_inner: this.#state.map.has_inner } });
    else if (event.key === "Enter") this.#pick(middle);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }
}

/** The places of positions on one disc; a position that lies on another one has a negative height. */
const onDisc =
  (disc: DiscProjection, discs: readonly DiscProjection[], shown: ReadyCase) =>
  (position: Vec3): Vec3 => {
    const found = placeOnMap(discs, shown.midsagittal, position);
    return found?.on === disc ? [...found.place, 1] : [0, 0, -1];
  };
