// The chosen case: one state, the panes that show it, and the hands that change it.

import { facing, edgesOf, mirrored, outwardAt, project, towardsViewer, viewName } from "../model/camera.ts";
import type { ReadyCase } from "../model/case.ts";
import { profileChart } from "./chart.ts";
import {
  type Change,
  type Command,
  deepen,
  dragWindow,
  invert,
  lookFrom,
  pan,
  pinch,
  turn,
  wheelZoom,
  zoomAt,
} from "../model/controls.ts";
import { Cube } from "../panes/cube.ts";
import { serverPictureDialog } from "./dialogs.ts";
import { h, setText } from "../base/dom.ts";
import { readState, writeAddress } from "../model/fragment.ts";
import { type GestureListener, listen } from "../panes/gestures.ts";
import { number, t } from "../base/i18n.ts";
import { mirrorPlane, plainPlane, reflected } from "../model/midsagittal.ts";
import { ColourBar, Overlay, SIDES } from "../panes/overlay.ts";
import { type Actions, DepthBar, Panel, intensityWords } from "./panel.ts";
import type { Preferences } from "./preferences.ts";
import { problemWords } from "../base/problem-words.ts";
import { PLANE_NAMES } from "../model/query.ts";
import { positionWords, voxelAt } from "../base/readout.ts";
import { saveScreenshot } from "../panes/screenshot.ts";
import { SlicePane } from "../panes/slices.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import { LAYOUTS, type Layout, type ViewState, sweptDepth, firstState, presetWindow } from "../model/state.ts";
import type { LoadProgress, Picked, Surface, SurfaceStatus } from "../panes/surface.ts";
import { createSurface } from "../panes/cortex.ts";

/** How long the state rests before the address follows it and the depth is read out. */
const REST_MS = 350;
/** A marked point that lies deeper than this behind what is seen of the surface is hidden. */
const HIDDEN_MM = 3;
/** The sweep's steps. */
const SWEEP_MS = 100;

/** What the page around the viewer does for it. */
export interface ViewerHost {
  readonly preferences: () => Preferences;
  readonly announce: (words: string) => void;
  readonly help: () => void;
  readonly serverOnly: boolean;
}

export class Viewer {
  readonly element: HTMLElement;
  readonly panel: Panel;
  readonly shown: ReadyCase;
  readonly #host: ViewerHost;
  readonly #surfaceHost = h("div", { class: "surface-host" });
  readonly #pane: HTMLElement;
  readonly #overlay: Overlay;
  readonly #otherOverlay: Overlay;
  readonly #colourBar = new ColourBar();
  readonly #cube = new Cube((name) => this.#command({ kind: "view", name }));
  readonly #panes = h("div", { class: "panes" });
  readonly #notices = h("div", { class: "notices" });
  readonly #fallback = h("p", { class: "notice-line", role: "status", hidden: true });
  readonly #trouble = h("p", { class: "notice-line bad", role: "alert", hidden: true });
  readonly #loading: HTMLElement;
  readonly #loadingBar = h("progress", { max: 1, "aria-label": t("load.label") });
  readonly #cancelLoad = h(
    "button",
    { type: "button", class: "cancel-load", click: () => this.#loadAbort.abort() },
    t("load.cancel"),
  );
  readonly #loadAgain = h(
    "button",
    { type: "button", class: "load-again", click: () => void this.load() },
    t("load.again"),
  );
  readonly #loadingText = h("span", {});
  readonly #depthBar: DepthBar;
  readonly #slices: readonly SlicePane[];
  readonly #observer: ResizeObserver;
  #loadAbort = new AbortController();
  #surface: Surface;
  #state: ViewState;
  #drawn: ViewState | null = null;
  #picked: Picked | null = null;
  #frame = 0;
  #moving = false;
  #rest = 0;
  #sweep = 0;
  #sweepDirection = 1;
  #timerShown = false;
  #saidDepth: number;
  #ghost: Vec2 | null = null;
  #disposed = false;

  constructor(shown: ReadyCase, rest: string, host: ViewerHost) {
    this.shown = shown;
    this.#host = host;
    this.#state = readState(rest, shown);
    this.#saidDepth = this.#state.depth_mm;
    const actions = this.#actions();
    this.panel = new Panel(shown, actions);
    this.#depthBar = new DepthBar(shown, actions);
    this.#pane = h(
      "section",
      {
        class: "pane surface",
        id: "surface",
        role: "application",
        tabindex: 0,
        "aria-label": t("surface.label"),
        "aria-describedby": "surface-keys",
      },
      this.#surfaceHost,
    );
    this.#overlay = new Overlay(this.#pane);
    this.#otherOverlay = new Overlay(this.#pane);
    this.#otherOverlay.element.classList.add("other");
    this.#pane.append(...SIDES.map((side) => h("span", { class: `ring ${side}` })));
    this.#pane.append(
      this.#colourBar.element,
      this.#cube.element,
      h("p", { id: "surface-keys", class: "visually-hidden" }, t("surface.keys")),
    );
    this.#slices = PLANE_NAMES.map(
      (plane) =>
        new SlicePane(plane, shown, {
          move: (position, done) => this.#moveCross(position, done),
          complain: (problem) => this.#complain(problem),
        }),
    );
    this.#loading = h(
      "div",
      { class: "notice-line", hidden: true },
      this.#loadingText,
      this.#loadingBar,
      this.#cancelLoad,
      this.#loadAgain,
    );
    this.#notices.append(this.#trouble, this.#fallback, this.#loading);
    this.#panes.append(this.#pane, h("div", { class: "slices" }, ...this.#slices.map((pane) => pane.element)));
    this.element = h("div", { class: "viewer" }, this.#notices, this.#panes, this.#depthBar.element);
    this.#surface = createSurface(this.#surfaceHost, shown, {
      onDrawn: (state) => this.#onDrawn(state),
      onStatus: (status) => this.#onStatus(status),
      serverOnly: host.serverOnly,
    });
    listen(this.#pane, this.#gestures());
    this.#pane.addEventListener("pointermove", (event) => this.#hover(event));
    this.#pane.addEventListener("pointerleave", () => this.#hover(null));
    this.#observer = new ResizeObserver(() => this.#schedule());
    for (const pane of [this.#pane, ...this.#slices.map((slice) => slice.element)]) this.#observer.observe(pane);
    this.#apply({});
  }

  get state(): ViewState {
    return this.#state;
  }

  /** Begins to fetch what the surface draws with; the element is in the page by now. */
  async load(): Promise<void> {
    this.#loadAbort = new AbortController();
    this.#showLoading(true);
    try {
      await this.#surface.load(this.#loadAbort.signal, (progress) => this.#onProgress(progress));
      this.#loading.hidden = true;
    } catch (error) {
      this.#loading.hidden = true;
      if (this.#disposed) return;
      if (this.#loadAbort.signal.aborted) this.#sayCancelled();
      else this.#complain(error);
    }
    this.element.dataset.loaded = "true";
    this.#showPoint();
    this.#schedule();
  }

  #sayCancelled(): void {
    this.#showLoading(false);
    setText(this.#loadingText, t("load.cancelled"));
    this.#loading.hidden = false;
    this.#host.announce(t("load.cancelled"));
    // The focus was on the button that is gone.
    if (document.activeElement === document.body) this.#loadAgain.focus();
  }

  #showLoading(isUnderWay: boolean): void {
    for (const element of [this.#loadingBar, this.#cancelLoad]) element.hidden = !isUnderWay;
    this.#loadAgain.hidden = isUnderWay;
  }

  /** Shows what the address says, which Back has changed. */
  restore(rest: string): void {
    this.#stopSweep();
    this.#picked = null;
    this.#state = readState(rest, this.shown);
    this.#apply({});
  }

  setLayout(layout: Layout): void {
    // The left side is what the mirrored right one is compared with.
    const left = layout === "mirror" && towardsViewer(this.#state.orientation)[0] < 0.2;
    this.#change({ layout, ...(left ? lookFrom("left") : {}) }, true);
    this.#host.announce(t(`layout.${layout}`));
  }

  /** A key that no control has taken. */
  command(command: Command): void {
    this.#command(command);
  }

  /** The server answers again: what could not be had is asked for once more. */
  again(): void {
    this.#trouble.hidden = true;
    this.#schedule();
  }

  /** Brings the address to where a sweep is, before the page is built anew from it. */
  settle(): void {
    this.#stopSweep();
    this.#follow("replace");
  }

  dispose(): void {
    this.#disposed = true;
    this.#stopSweep();
    clearTimeout(this.#rest);
    cancelAnimationFrame(this.#frame);
    this.#loadAbort.abort();
    this.#observer.disconnect();
    for (const slice of this.#slices) slice.dispose();
    this.#surface.dispose();
    this.element.remove();
    this.panel.element.remove();
  }

  /** The size of the picture of one view: in the layout `mirror` a half of the pane. */
  #paneSize(state: ViewState = this.#state): Vec2 {
    return [this.#pane.clientWidth / (state.layout === "mirror" ? 2 : 1), this.#pane.clientHeight];
  }

  /** A place of the pane within its half. */
  #inHalf(place: Vec2): Vec2 {
    const [width] = this.#paneSize();
    return [place[0] >= width && this.#state.layout === "mirror" ? place[0] - width : place[0], place[1]];
  }

  #change(change: Change, step = false): void {
    if (step) this.#follow("push");
    this.#state = { ...this.#state, ...change };
    this.#apply(change);
    if (step) this.#follow("replace");
  }

  /** Shows the state in the controls at once, and in the panes with the next frame. */
  #apply(change: Change): void {
    this.panel.show(this.#state);
    this.#depthBar.show(this.#state.depth_mm, this.#sweep !== 0);
    this.element.dataset.layout = this.#state.layout;
    if (change.layout === undefined || LAYOUTS.includes(change.layout))
      document.body.dataset.layout = this.#state.layout;
    if (change.crosshair_mm !== undefined || change.depth_mm !== undefined || Object.keys(change).length === 0)
      this.#showPoint();
    this.#schedule();
    clearTimeout(this.#rest);
    this.element.dataset.rested = "false";
    this.#rest = window.setTimeout(() => this.#onRest(), REST_MS);
  }

  #onRest(): void {
    if (this.#sweep !== 0) return;
    this.#follow("replace");
    this.element.dataset.rested = "true";
    if (this.#saidDepth === this.#state.depth_mm) return;
    this.#saidDepth = this.#state.depth_mm;
    this.#host.announce(t("depth.said", { depth: number(this.#state.depth_mm, 1) }));
  }

  /** The address follows the state: in place, or as a step that Back undoes. */
  #follow(how: "push" | "replace"): void {
    const address = writeAddress(this.#state, this.shown);
    if (how === "push") {
      history.replaceState(null, "", address);
      history.pushState(null, "", address);
    } else if (location.hash !== address) {
      history.replaceState(null, "", address);
    }
  }

  #schedule(): void {
    this.#frame ||= requestAnimationFrame(() => {
      this.#frame = 0;
      if (this.#disposed) return;
      this.#surface.draw(this.#state, this.#moving || this.#sweep !== 0);
      if (this.#state.layout === "slices") for (const slice of this.#slices) slice.show(this.#state);
      if (this.#drawn) this.#cross();
    });
  }

  #onDrawn(state: ViewState): void {
    this.#drawn = state;
    const [width] = this.#paneSize(state);
    const sphere = this.shown.envelope_sphere;
    const { mm_per_pixel } = project(state, sphere, this.#paneSize(state));
    const name = viewName(state.orientation);
    const title = `${number(state.depth_mm, 1)} mm${name ? `  ${t(`view.${name}`)}` : ""}`;
    const mirror = state.layout === "mirror";
    this.#overlay.letter(edgesOf(state.orientation));
    this.#overlay.title(title);
    this.#overlay.scale(mm_per_pixel, width);
    this.#otherOverlay.element.hidden = !mirror;
    this.#pane.classList.toggle("halved", mirror);
    if (mirror) {
      const edges = edgesOf(mirrored(state, mirrorPlane(this.shown), sphere).orientation);
      this.#otherOverlay.letter({ ...edges, left: edges.right, right: edges.left });
      // Of the side that is seen, from however near to its name's direction.
      const other = viewName(mirrored(state, plainPlane(sphere), sphere).orientation);
      this.#otherOverlay.title(
        `${number(state.depth_mm, 1)} mm${other ? `  ${t(`view.${other}`)}` : ""}`,
        t("mirror.badge"),
      );
      this.#otherOverlay.scale(mm_per_pixel, width);
    }
    this.#colourBar.show(state.window, state.colormap);
    this.#cube.show(state.orientation);
    this.#pane.dataset.depth = String(state.depth_mm);
    this.#pane.dataset.drawn = "true";
    setText(this.#pane.querySelector("#surface-keys") ?? this.#pane, `${surfaceWords(state)} ${t("surface.keys")}`);
    this.#cross();
  }

  /** The cross on the picture that is up: in the layout `mirror` at the same place of both halves. */
  #cross(): void {
    const state = this.#drawn;
    if (!state) return;
    const size = this.#paneSize(state);
    const mirror = state.layout === "mirror";
    const position = this.#state.crosshair_mm;
    if (!position) {
      this.#overlay.cursor(mirror ? this.#ghost : null, size, "ghost");
      return this.#otherOverlay.cursor(this.#ghost, size, "ghost");
    }
    const { pixelOf } = project(state, this.shown.envelope_sphere, size);
    const [own, reflection] = [pixelOf(position), pixelOf(reflected(position, mirrorPlane(this.shown)))];
    // Of the two halves the one that has the point in front: the other one has its mirror image.
    const isOther = mirror && reflection[2] > own[2];
    const [x, y] = isOther ? reflection : own;
    const kind = this.#isHidden(position, state, [isOther ? size[0] + x : x, y]) ? "hidden" : "mark";
    this.#overlay.cursor([x, y], size, isOther ? "ghost" : kind);
    this.#otherOverlay.cursor([x, y], size, isOther ? kind : "ghost");
  }

  /** Whether the surface lies before a position that is at a place of the pane. */
  #isHidden(position: Vec3, state: ViewState, place: Vec2): boolean {
    const sphere = this.shown.envelope_sphere;
    const size = this.#paneSize(state);
    const isOther = state.layout === "mirror" && place[0] >= size[0];
    const { pixelOf } = project(isOther ? mirrored(state, mirrorPlane(this.shown), sphere) : state, sphere, size);
    const height_mm = pixelOf(position)[2];
    const seen = this.#surface.pick(state, ...place);
    if (seen) return pixelOf(seen.position_in_patient)[2] > height_mm + HIDDEN_MM;
    // Until the surface is known, the far half of the head is behind it.
    return !this.#knowsSurface() && height_mm < 0;
  }

  #knowsSurface(): boolean {
    return this.#surface.probe(this.shown.envelope_sphere.center_in_patient) !== null;
  }

  #hover(event: PointerEvent | null): void {
    if (this.#state.layout !== "mirror") return;
    const box = this.#pane.getBoundingClientRect();
    this.#ghost = event && this.#inHalf([event.clientX - box.left, event.clientY - box.top]);
    if (!this.#state.crosshair_mm) this.#cross();
  }

  #onStatus(status: SurfaceStatus): void {
    this.element.dataset.way = status.way;
    this.element.dataset.fallback = status.fallback ?? "";
    setText(this.#fallback, status.fallback ? t(`fallback.${status.fallback}`) : "");
    this.#fallback.hidden = status.fallback === null;
    setText(this.#trouble, status.trouble);
    this.#trouble.hidden = status.trouble === "";
    this.#pane.classList.toggle("troubled", status.trouble !== "");
    if (!this.#disposed && this.#drawn) this.#schedule();
  }

  #onProgress({ loaded, total }: LoadProgress): void {
    this.#loading.hidden = total > 0 && loaded >= total;
    if (total > 0) this.#loadingBar.value = loaded / total;
    const megabytes = (bytes: number): string => number(bytes / 1e6, 1);
    setText(
      this.#loadingText,
      t("load.text", { loaded: megabytes(loaded), total: total > 0 ? megabytes(total) : "…" }),
    );
  }

  #complain(problem: unknown): void {
    const words = problem === null ? "" : problemWords(problem);
    setText(this.#trouble, words);
    this.#trouble.hidden = words === "";
  }

  #gestures(): GestureListener {
    return {
      drag: (kind, move) => {
        const size = this.#paneSize();
        if (kind === "turn") this.#change(turn(this.#state, move, size));
        else if (kind === "pan") this.#change(pan(this.#state, this.shown, move, size));
        else this.#change(dragWindow(this.#state, this.shown, move, this.#host.preferences().drag));
      },
      pinch: (fingers) => this.#change(pinch(this.#state, this.shown, fingers, this.#paneSize())),
      wheel: (pixels, notches, place, event) => {
        // A pinch on a touchpad comes as a wheel with the control key.
        const depth = !event.ctrlKey && event.altKey !== (this.#host.preferences().wheel === "depth");
        if (!depth)
          this.#change(
            zoomAt(
              this.#state,
              this.shown,
              wheelZoom(event.ctrlKey ? pixels * 5 : pixels),
              this.#inHalf(place),
              this.#paneSize(),
            ),
          );
        else if (notches !== 0) this.#command({ kind: "depth", steps: notches, fine: event.shiftKey });
      },
      pick: (place) => this.#pick(place),
      busy: (busy) => {
        this.#moving = busy;
        if (!busy) this.#schedule();
      },
    };
  }

  #command(command: Command): void {
    const size = this.#paneSize();
    const middle: Vec2 = [size[0] / 2, size[1] / 2];
    switch (command.kind) {
      case "depth":
        this.#stopSweep();
        return this.#change(deepen(this.#state, this.shown, command.steps, command.fine));
      case "turn":
      case "pan": {
        const move: Vec2 = [(command.move[0] * Math.min(...size)) / 1000, (command.move[1] * Math.min(...size)) / 1000];
        return this.#change(
          command.kind === "turn" ? turn(this.#state, move, size) : pan(this.#state, this.shown, move, size),
        );
      }
      case "zoom":
        return this.#change(zoomAt(this.#state, this.shown, command.factor, middle, size));
      case "view":
        this.#change(lookFrom(command.name), true);
        return this.#host.announce(t(`view.${command.name}`));
      case "window":
        this.#change({ window: presetWindow(command.preset, this.shown) }, true);
        return this.#host.announce(t("window.said", { name: t(`window.${command.preset}`) }));
      case "invert":
        return this.#change(invert(this.#state), true);
      case "reset": {
        const { layout, way, convention } = this.#state;
        this.#stopSweep();
        this.#picked = null;
        return this.#change({ ...firstState(this.shown), layout, way, convention }, true);
      }
      case "play":
        return this.#sweep === 0 ? this.#startSweep() : this.#stopSweep();
      case "timer":
        this.#timerShown = !this.#timerShown;
        this.#surface.showTimer(this.#timerShown);
        return this.#schedule();
      case "mark":
        return this.#pick(middle);
      case "help":
        return this.#host.help();
    }
  }

  #startSweep(): void {
    const step = (): void => {
      const [next, direction] = sweptDepth(this.#state.depth_mm, this.#sweepDirection, this.shown);
      this.#sweepDirection = direction;
      this.#change({ depth_mm: next });
    };
    this.#sweep = window.setInterval(step, SWEEP_MS);
    step();
  }

  #stopSweep(): void {
    if (this.#sweep === 0) return;
    clearInterval(this.#sweep);
    this.#sweep = 0;
    this.#apply({});
  }

  /** Puts the cross where the surface is seen at a place of the pane. */
  #pick(place: Vec2): void {
    const picked = this.#surface.pick(this.#state, place[0], place[1]);
    if (!picked) {
      // Until the depths are here nothing knows where the surface is.
      const words = t(
        this.#knowsSurface() ? "point.none" : this.element.dataset.loaded ? "point.unknown" : "point.loading",
      );
      this.panel.hint(words);
      return this.#host.announce(words);
    }
    this.#picked = picked;
    this.#change({ crosshair_mm: picked.position_in_patient }, true);
    this.#host.announce(t("point.said", { position: positionWords(picked.position_in_patient) }));
  }

  /** Puts the cross where a slice was touched; the surface turns to it when the hand has left. */
  #moveCross(position: Vec3, done: boolean): void {
    this.#picked = null;
    this.#change({ crosshair_mm: position, ...(done ? this.#facingChange(position) : {}) }, done);
  }

  #facingChange(position: Vec3): Change {
    const outward = outwardAt(position, this.shown.envelope_sphere);
    // The middle itself has no side.
    return Math.hypot(...outward) > 0.5 ? { orientation: facing(outward), pan_mm: [0, 0] } : {};
  }

  #showPoint(): void {
    const position = this.#state.crosshair_mm;
    if (!position) return this.panel.point(null, null);
    const probed = this.#surface.probe(position);
    const depth = this.#picked?.depth_mm ?? probed?.depth_mm;
    const voxel = voxelAt(this.shown, position);
    const profile = this.#surface.profile(position);
    this.panel.point(
      {
        position: positionWords(position),
        voxel: voxel ? voxel.map((part) => number(part)).join(", ") : t("point.outside"),
        depth: depth === undefined ? "–" : `${number(depth, 1)} mm`,
        intensity: intensityWords(this.#picked?.intensity ?? probed?.intensity),
      },
      profile && profileChart(profile, this.#state.depth_mm),
    );
  }

  #actions(): Actions {
    return {
      change: (change, step) => {
        this.#stopSweep();
        this.#change(change, step);
      },
      command: (command) => this.#command(command),
      turnToCross: () => {
        if (this.#state.crosshair_mm) this.#change(this.#facingChange(this.#state.crosshair_mm), true);
      },
      forgetCross: () => {
        this.#picked = null;
        this.#change({ crosshair_mm: null }, true);
      },
      depthOfCross: () => {
        const depth_mm = this.#state.crosshair_mm && this.#surface.probe(this.#state.crosshair_mm)?.depth_mm;
        if (typeof depth_mm === "number") this.#change(deepen({ ...this.#state, depth_mm }, this.shown, 0, true), true);
      },
      screenshot: () => void this.#screenshot(),
      serverPicture: () => serverPictureDialog(this.shown.id, this.#state, this.#paneSize()),
      copyAddress: () => void this.#copyAddress(),
    };
  }

  async #screenshot(): Promise<void> {
    try {
      await saveScreenshot(
        this.#panes,
        await this.#surface.picture(this.#state),
        this.#surfaceHost,
        `isocortex-${this.#state.depth_mm.toFixed(1)}mm.png`,
      );
      this.panel.note(t("export.saved"));
    } catch (error) {
      this.panel.note(problemWords(error));
    }
  }

  async #copyAddress(): Promise<void> {
    this.#follow("replace");
    try {
      await navigator.clipboard.writeText(location.href);
      this.panel.note(t("export.copied"));
    } catch {
      this.panel.note(location.href);
    }
  }
}

/** The surface of a state, for those who do not see it. */
function surfaceWords({ depth_mm, orientation }: ViewState): string {
  const name = viewName(orientation);
  return t("surface.alt", { depth: number(depth_mm, 1), view: t(`view.${name ?? "oblique"}`) });
}
