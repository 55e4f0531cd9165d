// The slice across the sulcus: a plane through the mark that holds the normal of the surface, turned by hand. The server
// draws it, and says how it lies.

import { send } from "../base/api.ts";
import { iconButton, setValue } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { FollowingPicture, decoded } from "../base/picture.ts";
import {
  type AcrossPlane,
  acrossSphere,
  acrossView,
  awayFrom,
  boundTurn,
  hasSides,
  readPlane,
  turnedPlane,
} from "../model/across.ts";
import { type Projection, edgesOf, project } from "../model/camera.ts";
import { pan, pinch, wheelZoom, zoomAt } from "../model/controls.ts";
import { sliceMarks } from "../model/marks.ts";
import { acrossQuery, pictureSize } from "../model/query.ts";
import { type Placing, withinReach } from "../model/slice-geometry.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import type { ViewState } from "../model/state.ts";
import { showAcross } from "../store/commands.ts";
import type { Store } from "../store/store.ts";
import { listen } from "./gestures.ts";
import { overlayWords, titleWords } from "./overlay.ts";
import { PlanePane } from "./plane-pane.ts";
import type { Placed } from "./screenshot.ts";
import { MOST_PIXELS, MOST_SAVED_PIXELS, type PlacedByHand, dragTheWindow } from "./slice-parts.ts";

/** How much of the head is seen at first, along the smaller side of the pane. */
const FIRST_MM = 90;
/** What a step of the wheel and of the arrows turns, in degrees; with the shift key, a fine one. */
const STEP_DEG = 5;
const FINE_STEP_DEG = 1;

interface Seen {
  readonly state: ViewState;
  readonly mark: Vec3;
  readonly turn_deg: number;
  readonly placing: Placing;
  readonly size: Vec2;
}

interface Drawn {
  readonly image: HTMLImageElement;
  /** Null if the server did not say how it lies. */
  readonly plane: AcrossPlane | null;
}

export class AcrossPane extends PlanePane {
  /** Hears how the plane lies; null: that is not known. */
  readonly #lies: (plane: AcrossPlane | null) => void;
  readonly #picture: FollowingPicture<Seen, Drawn>;
  /** What the picture that is up shows, and how it lies. */
  #drawn: (Seen & { readonly plane: AcrossPlane | null }) | null = null;

  constructor(store: Store, byHand: PlacedByHand, lies: (plane: AcrossPlane | null) => void) {
    const label = t("across.label");
    super(store, byHand, {
      name: "across",
      classes: "across",
      label,
      plane: label,
      zoom: (2 * store.shown.envelope_sphere.radius_mm) / FIRST_MM,
      pane: "across",
      range: { min: -90, max: 90, step: 1, "aria-label": t("across.turn") },
      buttons: [iconButton("close", t("across.close"), () => showAcross(store, null))],
    });
    this.#lies = lies;
    this.#picture = new FollowingPicture<Seen, Drawn>(
      { put: (drawn, seen) => this.#put(drawn, seen), complain: (problem) => this.complain(problem) },
      ({ path, about }) => drawnAt(path, about),
    );
    this.#listen();
  }

  /** Shows the plane through the state's mark. */
  show(state: ViewState): void {
    this.state = state;
    const seen = this.#seen(state);
    if (!seen || this.frame.clientWidth === 0) return;
    const path = this.#path(seen, pictureSize(this.size, devicePixelRatio, MOST_PIXELS));
    if (this.#picture.show(path, seen) && this.#drawn) this.#drawn = { ...seen, plane: this.#drawn.plane };
    setValue(this.range, seen.turn_deg);
    this.range.setAttribute("aria-valuetext", `${number(seen.turn_deg)}°`);
    this.write();
  }

  center(): void {
    this.setPlacing(this.home);
  }

  zoomTo(zoom: number): void {
    if (zoom !== this.placing.zoom) this.setPlacing({ ...this.placing, zoom });
  }

  /** The slice as it lies, with so many pixels to a CSS pixel, for a screenshot. */
  async placed(ratio: number): Promise<Placed | null> {
    const seen = this.state && this.#seen(this.state);
    if (!seen) return null;
    const { image } = await drawnAt(this.#path(seen, pictureSize(this.size, ratio, MOST_SAVED_PIXELS)), seen);
    return { element: this.frame, picture: image, isFlipped: false };
  }

  dispose(): void {
    this.#picture.stop();
    if (this.isLarge) this.store.large.value = null;
    this.#lies(null);
    this.element.remove();
  }

  #seen(state: ViewState): Seen | null {
    const { crosshair_mm: mark, across_deg: turn_deg } = state;
    return mark && turn_deg !== null ? { state, mark, turn_deg, placing: this.placing, size: this.size } : null;
  }

  #path({ state, mark, turn_deg }: Seen, size: Vec2): string {
    return this.path("oblique", acrossQuery(state, [mark, turn_deg], size));
  }

  #put({ image, plane }: Drawn, seen: Seen): void {
    this.#drawn = { ...seen, plane };
    image.alt = t("across.alt", { angles: anglesOf(plane), depth: number(seen.state.depth_mm, 1) });
    this.put(image, {
      turn: seen.turn_deg,
      position: seen.mark.join(),
      depth: seen.state.depth_mm,
      overlay: seen.state.overlay?.name ?? "",
      layer: seen.state.layer?.id ?? "",
    });
    this.mapBar.show(seen.state.overlay);
    this.write();
  }

  /** Words, marks and the cross are of the picture that is up: the one of another plane may come later. */
  protected write(): void {
    const [state, drawn] = [this.state, this.#drawn];
    const wanted = state && this.#seen(state);
    const { plane } = drawn ?? {};
    // Its traces follow the hand at once.
    const isOfMark = plane && wanted && plane.mark.join() === wanted.mark.join();
    this.#lies(isOfMark ? turnedPlane(plane, wanted.turn_deg) : null);
    const layer = drawn?.state.layer && titleWords(drawn.state.layer.about);
    const over = drawn?.state.overlay ? overlayWords(drawn.state.overlay) : "";
    const more = [layer, over].filter(Boolean).join(" · ");
    const badge = plane && hasSides(plane) ? t(`convention.${drawn?.state.convention ?? "radiological"}.badge`) : "";
    this.overlay.title(`${t("across.title")}\n${[anglesOf(plane ?? null), more].filter(Boolean).join(" · ")}`, badge);
    const projection = this.#projection();
    if (!drawn || !plane || !projection) {
      this.overlay.cursor(null, this.size, { kind: "mark" });
      this.overlay.marks([], this.size);
      return;
    }
    const { placing, size } = drawn;
    this.lie({ placing, size }, { placing: this.placing, size: this.size });
    this.overlay.letter(edgesOf(plane.orientation));
    this.overlay.scale(projection.mm_per_pixel, this.size[0]);
    const pixelOf = (point: Vec3): Vec2 => projection.pixelOf(point).slice(0, 2) as unknown as Vec2;
    const { place_mm = 0 } = drawn.state;
    this.overlay.cursor(pixelOf(plane.mark), this.size, { kind: "mark", place_mm });
    const inPlane = sliceMarks(this.marked, (point) => awayFrom(plane, point), pixelOf);
    this.overlay.marks(inPlane, this.size);
    this.sayHovered();
  }

  /** Where the patient is in the pane, in the plane of the picture that is up. */
  #projection(): Projection | null {
    const plane = this.#drawn?.plane;
    if (!plane) return null;
    return project(acrossView(plane, this.placing), acrossSphere(plane, this.shown.envelope_sphere), this.size);
  }

  protected positionAt([x, y]: Vec2): Vec3 | null {
    const projection = this.#projection();
    return projection && withinReach(this.shown, projection.positionOf([x, y, 0]));
  }

  protected slide(across_deg: number): void {
    this.store.view.change({ across_deg });
  }

  #turn(steps: number, isFine: boolean): void {
    const turn_deg = this.state?.across_deg ?? 0;
    const step_deg = isFine ? FINE_STEP_DEG : STEP_DEG;
    this.store.view.change({ across_deg: boundTurn(turn_deg + steps * step_deg) });
  }

  /** A click marks the point, or is one of the ruler's. */
  #tap(place: Vec2): void {
    const position = this.positionAt(place);
    if (!position) return;
    const tool = this.store.tool;
    if (tool) tool.add(position, "slice");
    else if (this.store.surface?.isInHead(position)) this.store.moveCross(position, true);
    else this.store.miss(t("point.beside"));
  }

  #listen(): void {
    const view = () => acrossView({ orientation: [0, 0, 0, 1] }, this.placing);
    listen(
      this.frame,
      {
        tap: (place) => this.#tap(place),
        drag: (kind, move) => {
          if (kind === "window") return dragTheWindow(this.store, move, this.pane);
          if (kind === "turn" && this.store.tool) return;
          this.place({ zoom: this.placing.zoom, ...pan(view(), this.shown, move, this.size) });
        },
        pinch: (fingers) => this.place(pinch(view(), this.shown, fingers, this.size)),
        wheel: (pixels, notches, place, event) => {
          // A pinch on a touchpad comes as a wheel with the control key.
          if (event.ctrlKey) this.place(zoomAt(view(), this.shown, wheelZoom(pixels * 2), place, this.size));
          else if (notches !== 0) this.#turn(-notches, event.shiftKey);
        },
        pick: () => {
          if (!this.store.tool) this.store.enlarge(this.name, true);
        },
        busy: () => {},
      },
      this.store.moves,
    );
    this.element.addEventListener("keydown", (event) => {
      if (event.target !== this.element || event.ctrlKey || event.metaKey || event.altKey) return;
      const steps = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[event.key];
      if (steps !== undefined) this.#turn(steps, event.shiftKey);
      else if (event.key === "Home") this.center();
      else return;
      event.preventDefault();
      event.stopPropagation();
    });
  }
}

/** The server's picture of a plane, and how it lies. */
async function drawnAt(path: string, { mark, turn_deg }: Seen): Promise<Drawn> {
  const answer = await send(`v1/cases/${path}`);
  const stated = readPlane(answer.headers.get("x-isocortex-plane"));
  const image = await decoded(await answer.blob());
  return { image, plane: stated && { ...stated, mark, turn_deg } };
}

/** The angles with their sign: `cor > sag 32°`. */
const anglesOf = (plane: AcrossPlane | null): string => plane?.angles.replace(/(\d)(?= >|$)/g, "$1°") ?? "";
