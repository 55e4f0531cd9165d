// The surface of a case in its pane: drawn here by WebGL where that can be, else by the server.

import type { ReadyCase } from "../model/case.ts";
import { type Centres, centresOf, surfacesOnMap } from "../model/flat-map.ts";
import { type Depths, depthsOf } from "../model/isosurface.ts";
import { type Picked, Points, type Probed } from "../model/points.ts";
import type { Profile } from "../model/profile.ts";
import { pictureSize } from "../model/query.ts";
import { type Sampler, samplerOf } from "../model/sampler.ts";
import type { SliceView } from "../model/slice-geometry.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import {
  allLayersOf,
  clampDepth,
  FIRST_DEPTH_MM,
  layersOf,
  surfacesOf,
  type ViewState,
  type Way,
} from "../model/state.ts";
import { type PartName, type SurfaceName, fitted, isPart, mirroredSurface } from "../model/surfaces.ts";
import { getCase, Problem } from "../base/api.ts";
import { h } from "../base/dom.ts";
import { patiently } from "../base/patience.ts";
import { troubleWords } from "../base/problem-words.ts";
import { TooLarge } from "../gl/gl.ts";
import type { Painter } from "../gl/painter.ts";
import { FULL_QUALITY, type Drawn, type FieldMaps, type Pane } from "../gl/scene.ts";
import { CaseData, type Voxels8Or16 } from "./case-data.ts";
import { Device, fitsMemory, handOver } from "./device.ts";
import { mapLooks, panesOf, slicePicture, withLayers } from "./looks.ts";
import { Pace } from "./pace.ts";
import { StandIn } from "./stand-in.ts";
import type { Fallback, LoadProgress, Surface, SurfaceOptions } from "../store/surface.ts";

/** The most device pixels for a CSS pixel: where software draws, and where a device does. */
const SOFTWARE_RATIO = 1;
const DEVICE_RATIO = 2;
/** So many pixels to a CSS pixel have soft edges in a picture that is saved. */
const MOST_SOFT_RATIO = 2;
const MOST_SLICE_PIXELS = 1600;

/** See `surface.ts`; it fills `host`. */
export class Cortex implements Surface {
  readonly #host: HTMLElement;
  readonly #case: ReadyCase;
  readonly #options: SurfaceOptions;
  readonly #canvas = h("canvas", { class: "cortex" });
  readonly #times = h("output", { class: "frame-times", hidden: true });
  readonly #resized = new ResizeObserver(() => this.#schedule());
  readonly #gone = new AbortController();
  readonly #data: CaseData;
  readonly #device: Device | null;
  readonly #pace = new Pace(() => this.#schedule());
  readonly #standIn: StandIn;
  #fallback: Fallback | null = null;
  /** What single points are found with: of the whole brain, once it is all here, and of parts; and the intensities. */
  readonly #fields = new Map<SurfaceName, Depths>();
  #volume: Sampler | null = null;
  readonly #points = new Map<SurfaceName, Points>();
  /** The facts of the surfaces of parts, and those that are being fetched. */
  readonly #parts = new Map<PartName, ReadyCase>();
  readonly #askedParts = new Set<PartName>();
  /** The surfaces that the flat map shows. */
  #onMap: readonly SurfaceName[] = [];
  #surface: SurfaceName = "whole";
  #centres: Centres | null = null;
  #state: ViewState | null = null;
  #moving = false;
  #frame = 0;
  #way: Exclude<Way, "auto">;
  /** Whether what the first picture needs did not come. */
  #gaveUp = false;
  /** The layers that are being fetched, and those that could not be fetched. */
  readonly #asked = new Set<string>();
  readonly #failed = new Set<string>();
  /** Whether slices are shown, which need the whole volume, and whether it was asked for. */
  #hasSlices = false;
  #wholeAsked = false;
  #trouble = "";
  #told = "";

  constructor(host: HTMLElement, shown: ReadyCase, options: SurfaceOptions) {
    this.#host = host;
    this.#case = shown;
    this.#options = options;
    host.append(this.#canvas, this.#times);
    this.#data = new CaseData(shown, this.#gone.signal, {
      first: (signal) => this.#onFirst(signal),
      more: (part, signal) => this.#bring((painter) => handOver(painter, part), signal),
      whole: (volume, maps) => this.#onWhole(volume, maps),
    });
    this.#standIn = new StandIn(this.#canvas, shown, {
      drawn: (state) => {
        // What was drawn here before is left standing until the first picture comes.
        this.#canvas.style.visibility = "hidden";
        this.#host.dataset.preview = String(!this.#data.hasFirst && !this.#isServed(state));
        this.#options.onDrawn({ ...state, swipe: null });
      },
      trouble: (words) => this.#say(words),
      served: (view) => this.served(view),
    });
    this.#device = options.serverOnly ? null : this.#taken();
    this.#way = this.#isServed() ? "server" : "mesh";
    this.#wholeAsked = options.shared !== null;
    this.#resized.observe(host);
    this.#tell();
  }

  /** Fetches what the first picture needs, then the rest. Rejects with the signal's reason when it is aborted. */
  async load(signal: AbortSignal, onProgress: (progress: LoadProgress) => void): Promise<void> {
    const both = AbortSignal.any([signal, this.#gone.signal]);
    // Everything is here already.
    if (!fitsMemory(this.#case) || this.#isComplete) return;
    this.#gaveUp = false;
    try {
      const { shared } = this.#options;
      const depth_mm = this.#state?.depth_mm ?? clampDepth(FIRST_DEPTH_MM, this.#case);
      if (shared) await this.#data.loadShared(shared, both, onProgress);
      else await this.#data.load(depth_mm, this.#device !== null, both, onProgress);
    } catch (error) {
      this.#gaveUp = !this.#data.fetched.field;
      this.#schedule();
      both.throwIfAborted();
      this.#fail(error);
      throw error;
    }
  }

  /** Draws with the next frame; `moving` allows a coarser picture from the server. */
  draw(state: ViewState, moving: boolean): void {
    // What failed is tried again when another layer has been chosen.
    if (allLayersOf(state).join() !== (this.#state && allLayersOf(this.#state).join())) this.#failed.clear();
    this.#pace.stir(moving, state !== this.#state);
    this.#state = state;
    this.#moving = moving;
    this.#schedule();
  }

  pick(state: ViewState, x: number, y: number): Picked | null {
    const other = this.pointsOf(mirroredSurface(state.surface)) ?? undefined;
    return this.pointsOf(state.surface)?.pick(state, [x, y], this.#cssSize(), other) ?? null;
  }

  profile(position_in_patient: Vec3): Profile | null {
    return this.pointsOf(this.#surface)?.profile(position_in_patient) ?? null;
  }

  probe(position_in_patient: Vec3): Probed | null {
    return this.pointsOf(this.#surface)?.probe(position_in_patient) ?? null;
  }

  get depths(): Depths | null {
    return this.pointsOf(this.#surface)?.depths ?? null;
  }

  wholeDepth(position_in_patient: Vec3): number | null {
    return this.pointsOf("whole")?.probe(position_in_patient).depth_mm ?? null;
  }

  get deepest_mm(): number | null {
    return isPart(this.#surface) ? (this.#parts.get(this.#surface)?.max_depth_mm ?? null) : null;
  }

  /** The state as the server is asked for it: a part is fitted into its pictures by its own sphere. */
  served(state: ViewState): ViewState {
    const part = isPart(state.surface) ? this.#parts.get(state.surface) : undefined;
    return part ? fitted(state, this.#case.envelope_sphere, part.envelope_sphere) : state;
  }

  isInHead(position_in_patient: Vec3): boolean {
    return this.pointsOf("whole")?.isInHead(position_in_patient) ?? true;
  }

  /** A picture of the state as it stands in the pane, with so many pixels to a CSS pixel, for a screenshot. */
  async picture(state: ViewState, ratio: number): Promise<CanvasImageSource> {
    const still = state.way === "auto" ? { ...state, way: "exact" as const } : state;
    const way = this.#drawable(still);
    const painter = this.#device?.painter;
    if (!way || !painter) return this.#standIn.picture(state, ratio) ?? this.#canvas;
    const { width } = this.#canvas;
    this.#fitCanvas(Math.min(ratio, this.#device?.mostPixels(this.#cssSize()) ?? ratio));
    // Edges of many pixels need not be softened, and the depths of all of them would be large.
    const depths = ratio > MOST_SOFT_RATIO ? 1 : 2;
    painter.draw(this.#panesOf(this.#available(state)), way, { ...FULL_QUALITY, depths });
    // In the same task, for what is drawn is gone with the next frame.
    const picture = createImageBitmap(this.#canvas);
    // What has the screen's pixels can stay there.
    if (this.#canvas.width !== width || this.#state?.swipe) this.#paint();
    return picture;
  }

  canSlice(state: ViewState): boolean {
    if (this.#isServed(state) || !this.#hasSurface(state.surface, false)) return false;
    return this.#device?.painter?.canSlice === true && this.#available(state) === state;
  }

  async slice(state: ViewState, view: SliceView, contours_mm: readonly number[]): Promise<ImageData | null> {
    this.#hasSlices = true;
    void this.#bringWhole();
    const painter = this.#isServed(state) ? null : this.#device?.painter;
    if (painter) {
      this.#bringLayers(state);
      this.#bringParts(surfacesOf(state), false);
    }
    if (!painter || !this.canSlice(state)) return null;
    const size = pictureSize(view.size, this.#ratio, MOST_SLICE_PIXELS);
    try {
      return await slicePicture(painter, state, view, this.#case, contours_mm, size);
    } catch (error) {
      this.#fail(error);
      return null;
    }
  }

  get centres(): Centres | null {
    return this.#centres;
  }

  canMap(state: ViewState): boolean {
    if (this.#isServed(state) || !this.#centres) return false;
    const surfaces = surfacesOnMap(state.map);
    return (
      this.#device?.painter?.canDraw("exact", state.depth_mm, surfaces) === true && this.#available(state) === state
    );
  }

  async map(state: ViewState, size: Vec2): Promise<ImageData | null> {
    this.#onMap = surfacesOnMap(state.map);
    const painter = this.#isServed(state) ? null : this.#device?.painter;
    if (painter) {
      this.#bringLayers(state);
      this.#bringMapped();
    }
    if (!painter || !this.#centres || !this.canMap(state)) return null;
    try {
      return await painter.map(mapLooks(state, this.#centres, this.#case), size);
    } catch (error) {
      this.#fail(error);
      return null;
    }
  }

  showTimer(shown: boolean): void {
    this.#times.hidden = !shown;
    this.#showTimes();
  }

  dispose(): void {
    this.#gone.abort();
    cancelAnimationFrame(this.#frame);
    this.#pace.stop();
    this.#resized.disconnect();
    this.#standIn.leave();
    this.#device?.dispose();
    for (const element of [this.#canvas, this.#times]) element.remove();
    this.#points.clear();
  }

  // -- What has come

  async #onFirst(signal: AbortSignal): Promise<void> {
    try {
      await this.#restore(signal);
    } catch (error) {
      signal.throwIfAborted();
      // A device that cannot draw leaves that to the server; points are found all the same.
      this.#fail(error);
    }
    this.#paint();
  }

  #onWhole(volume: Voxels8Or16, { field, smoothed }: FieldMaps): void {
    this.#fields.set("whole", depthsOf(field, { ...field, voxels: smoothed ?? field.voxels }));
    this.#volume = samplerOf(volume);
    this.#points.clear();
    this.#schedule();
    void this.#findCentres(field);
    void this.#bringWhole();
    this.#bringMapped();
  }

  /** Finds the middles of the hemispheres, which the flat map is drawn around. */
  async #findCentres(field: FieldMaps["field"]): Promise<void> {
    try {
      this.#centres = await patiently(centresOf(field, this.#case.midsagittal), this.#gone.signal);
      this.#told = "";
      this.#tell();
    } catch {
      // The case is closed.
    }
  }

  /** Fetches all that was acquired once the surface has all that it needs. Without it, the server draws the slices. */
  async #bringWhole(): Promise<void> {
    if (this.#wholeAsked || !this.#hasSlices || !this.#isComplete) return;
    this.#wholeAsked = true;
    const whole = await this.#data.loadWhole().catch(() => null);
    if (!whole || this.#gone.signal.aborted) return;
    this.#volume = samplerOf(whole);
    this.#points.clear();
    this.#canvas.dataset.whole = "true";
    this.#tell();
  }

  /** Whether the whole brain is all here. */
  get #isComplete(): boolean {
    return this.#fields.has("whole") && this.#volume !== null;
  }

  pointsOf(surface: SurfaceName): Points | null {
    const [depths, volume] = [this.#fields.get(surface), this.#volume];
    if (!depths || !volume) return null;
    const points = this.#points.get(surface) ?? new Points(this.#case, depths, volume);
    this.#points.set(surface, points);
    return points;
  }

  /** Fetches the surfaces of parts that a picture shows, each once. `failed` hears of those that cannot be fetched. */
  #bringParts(
    surfaces: readonly SurfaceName[],
    isServed: boolean,
    failed: (problem: unknown) => void = this.#options.noPart,
  ): void {
    for (const part of surfaces.filter(isPart)) {
      if (this.#askedParts.has(part) || !(this.#isComplete || isServed)) continue;
      this.#askedParts.add(part);
      this.#bringPart(part, !isServed).catch((problem: unknown) => {
        this.#askedParts.delete(part);
        if (!this.#gone.signal.aborted) failed(problem);
      });
    }
  }

  /** Fetches the surfaces of the flat map. Until they are here the server draws it, and says what there is to say. */
  #bringMapped(): void {
    if (!this.#isServed()) this.#bringParts(this.#onMap, false, () => (this.#onMap = []));
  }

  async #bringPart(part: PartName, draws: boolean): Promise<void> {
    if (!this.#parts.has(part)) {
      const shown = await getCase(this.#case.id, part);
      if (shown.state === "ready") this.#parts.set(part, shown);
      // The server can draw it from now on.
      this.#schedule();
    }
    if (draws) {
      const { field, smoothed, fenced } = await this.#data.loadPart(part);
      this.#fields.set(part, depthsOf(field, { ...field, voxels: smoothed ?? field.voxels }, fenced));
    }
    // The server draws with the facts alone; the rest is fetched once the page draws.
    else this.#askedParts.delete(part);
    // What waits for it besides the surface, as the flat map, is told.
    this.#told = "";
    this.#tell();
    this.#schedule();
  }

  /** Whether all surfaces of a picture can be drawn, here or by the server. */
  #hasSurfaces(state: ViewState, isServed: boolean): boolean {
    return surfacesOf(state).every((surface) => this.#hasSurface(surface, isServed));
  }

  /** Whether a surface can be drawn, here or by the server. */
  #hasSurface(surface: SurfaceName, isServed: boolean): boolean {
    if (!isPart(surface)) return true;
    if (!this.#parts.has(surface)) return false;
    return isServed || (this.#fields.has(surface) && this.#device?.painter?.hasSurface(surface) === true);
  }

  async #bring(work: (painter: Painter) => Generator<void, void>, signal: AbortSignal): Promise<void> {
    await this.#device?.bring(work, signal);
    this.#schedule();
  }

  // -- Drawing

  #schedule(): void {
    if (this.#frame !== 0 || this.#gone.signal.aborted) return;
    this.#frame = requestAnimationFrame(() => this.#paint());
  }

  #paint(): void {
    cancelAnimationFrame(this.#frame);
    this.#frame = 0;
    const state = this.#state;
    const css = this.#cssSize();
    if (!state || css[0] < 1 || css[1] < 1 || this.#gone.signal.aborted) return;
    const way = this.#drawable(state);
    const isWaiting = !this.#isServed(state) && this.#data.hasFirst && this.#hasSurfaces(state, false);
    if (way) this.#drawHere(state, way);
    else if (isWaiting) this.#data.wantDepth(state.depth_mm);
    else this.#drawThere(state);
  }

  #drawHere(state: ViewState, way: Drawn): void {
    const [gl, painter] = [this.#device?.gl, this.#device?.painter];
    if (!gl || !painter) return;
    const quality = this.#pace.qualityOf(way);
    const drawn = this.#available(state);
    const isWhole = drawn === state;
    if (!isWhole) this.#bringLayers(state);
    const isLast = quality === FULL_QUALITY && (state.way !== "auto" || way === "exact");
    const draw = (): void => {
      this.#fitCanvas();
      painter.draw(this.#panesOf(drawn), way, quality);
    };
    try {
      this.#pace.time(gl, { way, quality, isLast }, draw, () => this.#showTimes());
    } catch (error) {
      if (!gl.isContextLost()) this.#fail(error);
      return;
    }
    this.#bringMapped();
    this.#standIn.leave();
    delete this.#host.dataset.preview;
    this.#canvas.style.visibility = "visible";
    this.#way = way;
    this.#canvas.dataset.frames = String(this.#pace.frames);
    this.#canvas.dataset.complete = String(this.#isComplete);
    this.#canvas.dataset.quality = isLast && isWhole ? "full" : "less";
    if (this.#asked.size + this.#failed.size === 0) this.#say("");
    this.#surface = drawn.surface;
    this.#options.onDrawn(drawn);
    this.#tell();
  }

  /**
   * Lets the server draw: where it draws anyway, and until there is what the page draws with, or the surface of a part. Until the
   * server can draw that part, and without a server, there is no picture: never one of another surface.
   */
  #drawThere(state: ViewState): void {
    const isServed = this.#isServed(state);
    if (isServed) this.#way = "server";
    this.#surface = state.surface;
    const canServe = !this.#options.shared && this.#hasSurfaces(state, true);
    // What the page draws with itself comes after all of the whole brain.
    if (!canServe || (!isServed && this.#isComplete))
      this.#bringParts(surfacesOf(state), isServed || !this.#isComplete);
    if (canServe) this.#standIn.draw(state, this.#moving || (!isServed && !this.#data.hasFirst));
    else {
      this.#standIn.leave();
      this.#canvas.style.visibility = "hidden";
      this.#options.onDrawn(null);
    }
    this.#tell();
  }

  /** How a state can be drawn here and now; null where it cannot. */
  #drawable(state: ViewState): Drawn | null {
    const painter = this.#device?.painter;
    if (!painter || this.#isServed(state) || !this.#hasSurfaces(state, false)) return null;
    const wanted = state.way === "auto" ? this.#pace.way : state.way;
    const canDraw = (way: Drawn): boolean => painter.canDraw(way, state.depth_mm, surfacesOf(state));
    const hasMesh = canDraw("mesh");
    // The mesh of a part comes after the part; a file has none.
    const mayLackMesh = isPart(state.surface) || this.#options.shared !== null;
    if ((wanted === "exact" || (!hasMesh && mayLackMesh)) && canDraw("exact")) return "exact";
    return hasMesh ? "mesh" : null;
  }

  /** Whether the server draws: permanently, or while the state asks for it. */
  #isServed(state: ViewState | null = this.#state): boolean {
    return this.#options.serverOnly || this.#gaveUp || this.#fallback !== null || state?.way === "server";
  }

  #panesOf(state: ViewState): Pane[] {
    return panesOf(state, [this.#canvas.width, this.#canvas.height]);
  }

  /** The state with those of its layers whose voxels are here; without its texture, with the case's own. */
  #available(state: ViewState): ViewState {
    return withLayers(state, this.#case, (name) => this.#device?.painter?.hasLayer(name) ?? false);
  }

  /** Fetches the voxels of layers, each once, and draws with them. */
  #bringLayers(state: ViewState): void {
    for (const name of layersOf(state)) {
      if (this.#asked.has(name) || this.#failed.has(name) || this.#device?.painter?.hasLayer(name)) continue;
      this.#asked.add(name);
      void this.#bringLayer(name);
    }
  }

  /** Drops the voxels of a layer, which are fetched again if it is shown. */
  forgetLayer(name: string): void {
    this.#asked.delete(name);
    this.#failed.delete(name);
    this.#device?.painter?.dropLayer(name);
  }

  async #bringLayer(name: string): Promise<void> {
    try {
      const layer = await this.#options.layer(name);
      if (!this.#asked.has(name)) return;
      await this.#bring((painter) => painter.setLayer(name, layer), this.#gone.signal);
      this.#asked.delete(name);
      // Slices that wait for it are told.
      this.#told = "";
      this.#tell();
    } catch (error) {
      this.#asked.delete(name);
      this.#failed.add(name);
      this.#fail(error);
    }
  }

  #cssSize(): Vec2 {
    return [this.#host.clientWidth, this.#host.clientHeight];
  }

  get #ratio(): number {
    return Math.min(globalThis.devicePixelRatio, this.#device?.isSoftware ? SOFTWARE_RATIO : DEVICE_RATIO);
  }

  #fitCanvas(ratio = this.#ratio): void {
    const [width, height] = this.#cssSize().map((side) => Math.max(1, Math.round(side * ratio))) as [number, number];
    if (this.#canvas.width !== width) this.#canvas.width = width;
    if (this.#canvas.height !== height) this.#canvas.height = height;
  }

  #showTimes(): void {
    if (!this.#times.hidden) this.#times.value = this.#pace.words;
  }

  // -- The device

  #taken(): Device | null {
    const device = Device.take(this.#canvas, this.#case, {
      lost: () => this.#onLost(),
      restored: () => void this.#restore(this.#gone.signal).catch((error: unknown) => this.#fail(error)),
    });
    if (!device) this.#fallback = "no-webgl2";
    else if (!device.fits) this.#fallback = "too-large";
    return device;
  }

  #onLost(): void {
    // An opaque canvas without its context is white.
    this.#canvas.style.visibility = "hidden";
    this.#fallback = "context-lost";
    this.#schedule();
    this.#tell();
  }

  /** Brings all that has been fetched to the device, at first or after a lost context. */
  async #restore(signal: AbortSignal): Promise<void> {
    if (this.#fallback === "too-large" || !(await this.#device?.fill(this.#data.fetched, signal))) return;
    this.#fallback = null;
    this.#schedule();
    this.#tell();
  }

  // -- Telling

  #fail(error: unknown): void {
    if (this.#gone.signal.aborted) return;
    if (error instanceof TooLarge) this.#fallback ??= "too-large";
    else if (!(error instanceof Problem)) this.#fallback ??= "failed";
    this.#say(error instanceof Problem ? troubleWords(error) : error instanceof Error ? error.message : "");
    this.#schedule();
  }

  #say(trouble: string): void {
    this.#trouble = trouble;
    this.#tell();
  }

  #tell(): void {
    const canSlice = this.#state !== null && this.canSlice(this.#state);
    const [fallback, trouble, surface] = [this.#fallback, this.#trouble, this.#surface];
    const status = { way: this.#way, fallback, trouble, canSlice, surface };
    const told = JSON.stringify(status);
    if (told === this.#told) return;
    this.#told = told;
    this.#options.onStatus(status);
  }
}
