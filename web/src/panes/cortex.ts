// The surface of a case in its pane: drawn here by WebGL where that can be, else by the server.

import { Assets, ByteCount, COARSE_STEP } from "./assets.ts";
import { Problem } from "../base/api.ts";
import { mirrored, project, towardsViewer } from "../model/camera.ts";
import type { ReadyCase } from "../model/case.ts";
import { colorRow } from "../gl/colors.ts";
import { h } from "../base/dom.ts";
import { borderBox, gradients, smoothed } from "../model/field.ts";
import { TooLarge, type Gl, type ShaderTexts } from "../gl/gl.ts";
import { depthsOf, firstHit, type Depths } from "../model/isosurface.ts";
import { mirrorPlane, reflected } from "../model/midsagittal.ts";
import {
  fits,
  FULL_QUALITY,
  Painter,
  textureBytes,
  type Drawn,
  type FieldMaps,
  type Pane,
  type Quality,
} from "../gl/painter.ts";
import { patiently } from "../base/patience.ts";
import { profileAt } from "../model/profile.ts";
import { samplerOf, type Sampler } from "../model/sampler.ts";
import { createServerSurface } from "./server-surface.ts";
import { scale, type Vec2, type Vec3 } from "../model/space.ts";
import { clampDepth, FIRST_DEPTH_MM, type ViewState, type Way } from "../model/state.ts";
import type { Profile } from "../model/profile.ts";
import type {
  CreateSurface,
  Fallback,
  LoadProgress,
  Picked,
  Surface,
  SurfaceOptions,
  SurfaceStatus,
} from "./surface.ts";
import { FrameTimer } from "../gl/timer.ts";
import type { Look } from "../gl/uniforms.ts";
import { voxelCount, type Block, type PathsTable } from "../model/wire.ts";

/** The most bytes on the device that a case may take. */
const MOST_TEXTURE_BYTES = 1 << 30;
/** The most device pixels for a CSS pixel: where software draws, and where a device does. */
const SOFTWARE_RATIO = 1;
const DEVICE_RATIO = 2;
/** Frames that take longer than this are drawn with less while something changes: see `Cortex.#qualityOf`. */
const SLOW_FRAME_MS = 40;
const COARSE_SHARE = 0.5;
/** After so long without a frame everything rests. */
const REST_MS = 150;

type Voxels8Or16 = Block<Uint8Array<ArrayBuffer> | Uint16Array<ArrayBuffer>>;

/** What has been fetched of a case; a lost context is filled from it again. */
interface Fetched {
  shaders: ShaderTexts | null;
  triangles: Uint32Array<ArrayBuffer> | null;
  positions: { readonly positions: Float32Array<ArrayBuffer>; readonly depth_mm: number } | null;
  paths: PathsTable | null;
  volume: Voxels8Or16 | null;
  field: FieldMaps | null;
}

/** What is known on the processor, for single points. */
interface Known {
  readonly depths: Depths;
  readonly volume: Sampler;
}

/** See `surface.ts`. */
export const createSurface: CreateSurface = (host, shown, options) => new Cortex(host, shown, options);

class Cortex implements Surface {
  readonly #host: HTMLElement;
  readonly #case: ReadyCase;
  readonly #options: SurfaceOptions;
  readonly #canvas = h("canvas", { class: "cortex" });
  readonly #times = h("output", { class: "frame-times", hidden: true });
  readonly #full_ms: Record<Drawn, number> = { mesh: 0, exact: 0 };
  readonly #resized = new ResizeObserver(() => this.#schedule());
  readonly #gone = new AbortController();
  readonly #fetched: Fetched = {
    shaders: null,
    triangles: null,
    positions: null,
    paths: null,
    volume: null,
    field: null,
  };
  readonly #timer = new FrameTimer();
  #gl: Gl | null = null;
  /** Ends with the context: what was being brought to it is of no use to the next one. */
  #context = new AbortController();
  #painter: Painter | null = null;
  #isSoftware = false;
  #fallback: Fallback | null = null;
  #known: Known | null = null;
  #state: ViewState | null = null;
  #moving = false;
  #frame = 0;
  /** Whether nothing changes: said by the clock alone, for on a slow device a frame may last longer than any rest. */
  #resting = true;
  #rest = 0;
  #way: Way;
  #server: { readonly surface: Surface; readonly box: HTMLElement } | null = null;
  /** Whether what the first picture needs did not come. */
  #gaveUp = false;
  #trouble = "";
  #told = "";
  /** Fetches the positions of a depth while there is no table of all depths. */
  #fetchPositions: ((depth_mm: number) => void) | null = null;

  constructor(host: HTMLElement, shown: ReadyCase, options: SurfaceOptions) {
    this.#host = host;
    this.#case = shown;
    this.#options = options;
    this.#canvas.style.cssText = "position:absolute;inset:0;width:100%;height:100%;display:block";
    this.#times.style.cssText =
      "position:absolute;left:0;top:2.6rem;padding:2px 6px;background:#000c;color:#fff;font:12px monospace;z-index:2";
    host.append(this.#canvas, this.#times);
    this.#canvas.addEventListener("webglcontextlost", this.#onLost);
    this.#canvas.addEventListener("webglcontextrestored", this.#onRestored);
    if (!options.serverOnly) this.#begin();
    this.#way = this.#isServed() ? "server" : "mesh";
    this.#resized.observe(host);
    this.#tell();
  }

  async load(signal: AbortSignal, onProgress: (progress: LoadProgress) => void): Promise<void> {
    const both = AbortSignal.any([signal, this.#gone.signal]);
    const assets = new Assets(this.#case.id, both, new ByteCount(onProgress));
    if (!this.#fitsMemory()) return;
    this.#gaveUp = false;
    try {
      // Asked for again, the rest alone is wanted where the first picture came.
      if (this.#gl && !this.#fetchPositions) await this.#loadFirst(assets, both);
      await this.#loadRest(assets, both);
    } catch (error) {
      this.#gaveUp = !this.#fetched.field;
      this.#schedule();
      both.throwIfAborted();
      this.#fail(error);
      throw error;
    }
  }

  draw(state: ViewState, moving: boolean): void {
    if (state !== this.#state || moving) this.#resting = false;
    this.#state = state;
    this.#moving = moving;
    this.#schedule();
  }

  pick(state: ViewState, x: number, y: number): Picked | null {
    const known = this.#known;
    if (!known) return null;
    const css = this.#cssSize();
    const isMirror = state.layout === "mirror";
    const size: Vec2 = isMirror ? [css[0] / 2, css[1]] : css;
    const isOther = isMirror && x >= size[0];
    const view = isOther ? mirrored(state, mirrorPlane(this.#case), this.#case.envelope_sphere) : state;
    const place: Vec2 = isOther ? [2 * size[0] - x, y] : [x, y];
    const reach_mm = this.#case.envelope_sphere.radius_mm + 10;
    const from = project(view, this.#case.envelope_sphere, size).positionOf([...place, reach_mm]);
    const direction = scale(towardsViewer(view.orientation), -1);
    const position = firstHit(known.depths, { from, direction, reach_mm: 2 * reach_mm }, state.depth_mm);
    if (!position) return null;
    const intensity = known.volume.atPatient(position);
    return {
      position_in_patient: position,
      depth_mm: state.depth_mm,
      intensity: Number.isNaN(intensity) ? null : intensity,
      normal_in_patient: scale(known.depths.inwardAt(position), -1),
    };
  }

  profile(position_in_patient: Vec3): Profile | null {
    const known = this.#known;
    const opposite = reflected(position_in_patient, mirrorPlane(this.#case));
    return known && profileAt(known.depths, known.volume, position_in_patient, opposite);
  }

  probe(position_in_patient: Vec3): { readonly depth_mm: number; readonly intensity: number } | null {
    const known = this.#known;
    if (!known) return null;
    return {
      depth_mm: known.depths.depthAt(position_in_patient),
      intensity: known.volume.atPatient(position_in_patient),
    };
  }

  async picture(state: ViewState): Promise<CanvasImageSource> {
    const way = this.#drawable(state);
    if (way && this.#painter && this.#gl) {
      this.#fitCanvas();
      this.#painter.draw(this.#panes(state), way, FULL_QUALITY);
      // In the same task, for what is drawn is gone with the next frame.
      return createImageBitmap(this.#canvas);
    }
    return this.#server?.surface.picture(state) ?? this.#canvas;
  }

  showTimer(shown: boolean): void {
    this.#times.hidden = !shown;
    this.#showTimes();
  }

  dispose(): void {
    this.#gone.abort(new DOMException("The surface is shown no more.", "AbortError"));
    cancelAnimationFrame(this.#frame);
    clearTimeout(this.#rest);
    this.#resized.disconnect();
    this.#showServer(false);
    this.#canvas.removeEventListener("webglcontextlost", this.#onLost);
    this.#canvas.removeEventListener("webglcontextrestored", this.#onRestored);
    // A page may hold few contexts: this one is given back at once.
    this.#gl?.getExtension("WEBGL_lose_context")?.loseContext();
    for (const element of [this.#canvas, this.#times]) element.remove();
    this.#gl = this.#painter = this.#known = null;
  }

  // -- Fetching

  async #loadFirst(assets: Assets, signal: AbortSignal): Promise<void> {
    const depth_mm = this.#state?.depth_mm ?? clampDepth(FIRST_DEPTH_MM, this.#case);
    const volume = voxelCount(this.#case.grid.size);
    const [shaders, triangles, positions, quick, coarse] = await Promise.all([
      assets.shaders(),
      assets.triangles(),
      assets.positions(depth_mm),
      assets.volume(8, volume),
      assets.distance("coarse", volume / 32),
    ]);
    const fetched = this.#fetched;
    fetched.shaders = shaders;
    fetched.triangles = triangles;
    fetched.positions = { positions, depth_mm };
    fetched.volume = quick;
    fetched.field = await patiently(coarseMaps(coarse), signal);
    try {
      await this.#restore(signal);
    } catch (error) {
      signal.throwIfAborted();
      // A device that cannot draw leaves that to the server; points are found all the same.
      this.#fail(error);
    }
    // Other depths are wanted even when the table of all of them was cancelled.
    this.#fetchPositions = this.#positionsFetcher(
      new Assets(this.#case.id, this.#gone.signal, new ByteCount(() => {})),
    );
    this.#paint();
  }

  /** One request at a time, of the latest depth. */
  #positionsFetcher(assets: Assets): (depth_mm: number) => void {
    let isRunning = false;
    let wanted: number | null = null;
    const run = async (): Promise<void> => {
      isRunning = true;
      for (; wanted !== null && !this.#fetched.paths;) {
        const depth_mm = wanted;
        wanted = null;
        const positions = await assets.positions(depth_mm);
        this.#fetched.positions = { positions, depth_mm };
        this.#painter?.setPositions(positions, depth_mm);
        this.#paint();
      }
      isRunning = false;
    };
    return (depth_mm) => {
      wanted = depth_mm;
      // The table of all depths follows; what goes wrong with it is said.
      if (!isRunning) run().catch(() => (isRunning = false));
    };
  }

  async #loadRest(assets: Assets, signal: AbortSignal): Promise<void> {
    const voxels = voxelCount(this.#case.grid.size);
    const table = async (): Promise<void> => {
      if (!this.#gl) return;
      this.#fetched.paths = await assets.paths();
      this.#painter?.setPaths(this.#fetched.paths);
      this.#paint();
    };
    const volume = async (): Promise<Voxels8Or16> => {
      const whole = await assets.volume(16, 2 * voxels);
      this.#fetched.volume = whole;
      await this.#bring((painter) => painter.setVolume(whole), signal);
      return whole;
    };
    const maps = async (): Promise<FieldMaps> => {
      const field = await assets.distance("all", 2 * voxels);
      const made = await patiently(fieldMaps(field), signal);
      this.#fetched.field = made;
      await this.#bring((painter) => painter.setField(made), signal);
      return made;
    };
    const [whole, made] = await Promise.all([volume(), maps(), table()]);
    // The gradients are on the device; after a lost context they are made again.
    const smooth = made.smoothed ?? made.field.voxels;
    this.#known = { depths: depthsOf(made.field, { ...made.field, voxels: smooth }), volume: samplerOf(whole) };
    this.#fetched.field = { ...made, gradients: new Int8Array() };
    this.#schedule();
  }

  /** Brings something to the device, if there is one; after a lost context it is brought with all the rest. */
  async #bring(work: (painter: Painter) => Generator<void, void>, signal: AbortSignal): Promise<void> {
    const painter = this.#painter;
    if (!painter) return;
    const context = this.#context.signal;
    try {
      await patiently(work(painter), AbortSignal.any([signal, context]));
    } catch (error) {
      if (!context.aborted) throw error;
    }
    this.#schedule();
  }

  /** Brings all that has been fetched to the device. */
  async #fill(painter: Painter, fetched: Fetched, signal: AbortSignal): Promise<void> {
    const { triangles, positions, paths, volume, field } = fetched;
    if (triangles) painter.setTriangles(triangles);
    if (positions) painter.setPositions(positions.positions, positions.depth_mm);
    if (paths) painter.setPaths(paths);
    if (volume) await patiently(painter.setVolume(volume), signal);
    if (field) await patiently(painter.setField(field), signal);
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
    if (way && this.#painter && this.#gl) this.#drawHere(state, way);
    else if (this.#waitsForPositions(state)) this.#fetchPositions?.(state.depth_mm);
    else if (this.#isServed(state)) this.#drawThere(state);
  }

  #drawHere(state: ViewState, way: Drawn): void {
    const [gl, painter] = [this.#gl, this.#painter];
    if (!gl || !painter) return;
    const quality = this.#qualityOf(way);
    const heard = (frame_ms: number): void => {
      if (quality === FULL_QUALITY) this.#full_ms[way] = frame_ms;
      this.#showTimes();
    };
    try {
      this.#timer.time(
        gl,
        () => {
          this.#fitCanvas();
          painter.draw(this.#panes(state), way, quality);
        },
        heard,
      );
    } catch (error) {
      if (!gl.isContextLost()) this.#fail(error);
      return;
    }
    clearTimeout(this.#rest);
    this.#rest = window.setTimeout(() => this.#onRest(quality), REST_MS);
    this.#showServer(false);
    this.#canvas.style.visibility = "visible";
    this.#way = way;
    this.#canvas.dataset.frames = String(this.#timer.times.frames);
    this.#canvas.dataset.complete = String(this.#known !== null);
    this.#canvas.dataset.quality = quality === FULL_QUALITY ? "full" : "less";
    this.#complain(null);
    this.#options.onDrawn(state);
    this.#tell();
  }

  /**
   * On a slow device a picture that changes is drawn with less: the mesh with hard edges, and while something is
   * dragged, the isosurface at half the resolution. As soon as it rests it is drawn in full.
   */
  #qualityOf(way: Drawn): Quality {
    if (this.#full_ms[way] <= SLOW_FRAME_MS) return FULL_QUALITY;
    if (way === "exact") return this.#moving ? { share: COARSE_SHARE, depths: 2 } : FULL_QUALITY;
    return this.#resting ? FULL_QUALITY : { share: 1, depths: 1 };
  }

  /** What was drawn with less is drawn in full. */
  #onRest(quality: Quality): void {
    if (this.#moving) return;
    this.#resting = true;
    if (quality !== FULL_QUALITY) this.#schedule();
  }

  #drawThere(state: ViewState): void {
    this.#showServer(true);
    this.#way = "server";
    this.#server?.surface.draw(state, this.#moving);
    this.#tell();
  }

  /** How a state can be drawn here and now; null where it cannot. */
  #drawable(state: ViewState): Drawn | null {
    const painter = this.#painter;
    if (!painter || this.#fallback || state.way === "server" || this.#options.serverOnly) return null;
    if (state.way === "exact" && painter.canDraw("exact", state.depth_mm)) return "exact";
    return painter.canDraw("mesh", state.depth_mm) ? "mesh" : null;
  }

  /** Whether the server is to draw: for good, or as long as the page wants it so. */
  #isServed(state: ViewState | null = this.#state): boolean {
    return this.#options.serverOnly || this.#gaveUp || this.#fallback !== null || state?.way === "server";
  }

  /** Whether all but the mesh of this depth is there. */
  #waitsForPositions(state: ViewState): boolean {
    return !this.#isServed(state) && this.#fetchPositions !== null;
  }

  #panes(state: ViewState): Pane[] {
    const [width, height] = [this.#canvas.width, this.#canvas.height];
    const look: Look = { ...state, color_row: colorRow(state.colormap), isMirrored: false };
    if (state.layout !== "mirror") return [{ look, left: 0, size: [width, height] }];
    const half = Math.floor(width / 2);
    return [
      { look, left: 0, size: [half, height] },
      { look: { ...look, isMirrored: true }, left: width - half, size: [half, height] },
    ];
  }

  #cssSize(): Vec2 {
    return [this.#host.clientWidth, this.#host.clientHeight];
  }

  #pixelSize(): Vec2 {
    const ratio = Math.min(globalThis.devicePixelRatio, this.#isSoftware ? SOFTWARE_RATIO : DEVICE_RATIO);
    const [width, height] = this.#cssSize();
    return [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
  }

  #fitCanvas(): void {
    const [width, height] = this.#pixelSize();
    if (this.#canvas.width !== width) this.#canvas.width = width;
    if (this.#canvas.height !== height) this.#canvas.height = height;
  }

  #showServer(isShown: boolean): void {
    if (isShown === (this.#server !== null)) return;
    if (!isShown) {
      this.#server?.surface.dispose();
      this.#server?.box.remove();
      this.#server = null;
      return;
    }
    const box = h("div", { class: "served" });
    this.#canvas.after(box);
    const surface = createServerSurface(box, this.#case, {
      serverOnly: true,
      onStatus: ({ trouble }) => this.#say(trouble),
      onDrawn: (state) => {
        // What was drawn here before is left standing until the first picture comes.
        this.#canvas.style.visibility = "hidden";
        this.#options.onDrawn(state);
      },
    });
    this.#server = { surface, box };
  }

  #showTimes(): void {
    if (this.#times.hidden) return;
    const { script_ms, frame_ms, frames } = this.#timer.times;
    this.#times.value = `${frame_ms.toFixed(1)} ms · JS ${script_ms.toFixed(2)} ms · ${frames}`;
  }

  // -- The device

  /** Takes a context. */
  #begin(): void {
    const gl = this.#canvas.getContext("webgl2", {
      alpha: false,
      antialias: false,
      depth: false,
      powerPreference: "high-performance",
    });
    if (!gl) {
      this.#fallback = "no-webgl2";
      return;
    }
    this.#gl = gl;
    this.#isSoftware = /swiftshader|llvmpipe|software/i.test(rendererOf(gl));
    if (!this.#fitsDevice(gl)) this.#fallback = "too-large";
  }

  /** The volume is cropped to the envelope; before it comes, its native size bounds it. */
  #fitsDevice(gl: Gl): boolean {
    return fits(gl, [this.#case.grid.size, this.#case.volume.size]) && this.#fitsMemory();
  }

  #fitsMemory(): boolean {
    return textureBytes(this.#case.grid.size, this.#case.volume.size) <= MOST_TEXTURE_BYTES;
  }

  readonly #onLost = (event: Event): void => {
    // Without this, the context would never come back.
    event.preventDefault();
    this.#painter = null;
    this.#context.abort(new DOMException("The context was lost.", "AbortError"));
    this.#context = new AbortController();
    // An opaque canvas without its context is white.
    this.#canvas.style.visibility = "hidden";
    this.#fallback = "context-lost";
    this.#schedule();
    this.#tell();
  };

  readonly #onRestored = (): void => {
    this.#restore(this.#gone.signal).catch((error: unknown) => this.#fail(error));
  };

  /** Brings all that has been fetched to the device, at first or after a lost context. */
  async #restore(signal: AbortSignal): Promise<void> {
    const [gl, { shaders }] = [this.#gl, this.#fetched];
    if (!gl || !shaders || gl.isContextLost() || this.#fallback === "too-large") return;
    const context = this.#context.signal;
    try {
      this.#painter = await this.#filled(gl, shaders, AbortSignal.any([signal, context]));
    } catch (error) {
      // The next context begins anew.
      if (context.aborted) return;
      throw error;
    }
    this.#fallback = null;
    this.#schedule();
    this.#tell();
  }

  /** A painter that has all that has been fetched. */
  async #filled(gl: Gl, shaders: ShaderTexts, signal: AbortSignal): Promise<Painter> {
    const native_spacing_mm = Math.min(...this.#case.volume.spacing_mm);
    const { envelope_sphere: sphere } = this.#case;
    const painter = new Painter(gl, shaders, { sphere, plane: mirrorPlane(this.#case), native_spacing_mm });
    let fetched: Fetched;
    do {
      fetched = { ...this.#fetched };
      await this.#fill(painter, { ...fetched, field: await withGradients(fetched.field, signal) }, signal);
      // What came meanwhile is brought as well.
    } while (
      fetched.paths !== this.#fetched.paths ||
      fetched.volume !== this.#fetched.volume ||
      fetched.field !== this.#fetched.field
    );
    signal.throwIfAborted();
    return painter;
  }

  // -- Telling

  #fail(error: unknown): void {
    if (this.#gone.signal.aborted) return;
    if (error instanceof TooLarge) this.#fallback ??= "too-large";
    else if (!(error instanceof Problem)) this.#fallback ??= "failed";
    this.#complain(error);
    this.#schedule();
    this.#tell();
  }

  #complain(problem: unknown): void {
    this.#say(problem instanceof Error ? problem.message : "");
  }

  #say(trouble: string): void {
    this.#trouble = trouble;
    this.#tell();
  }

  #tell(): void {
    const status: SurfaceStatus = { way: this.#way, fallback: this.#fallback, trouble: this.#trouble };
    const told = JSON.stringify(status);
    if (told === this.#told) return;
    this.#told = told;
    this.#options.onStatus(status);
  }
}

/** The light alone, from every so manieth depth. */
function* coarseMaps(field: Block<Int16Array<ArrayBuffer>>): Generator<void, FieldMaps> {
  return { field, smoothed: null, gradients: yield* gradients(field.voxels, field.size, COARSE_STEP), borderBox: null };
}

/** All that is made of the depths. */
function* fieldMaps(field: Block<Int16Array<ArrayBuffer>>): Generator<void, FieldMaps> {
  const smooth = yield* smoothed(field.voxels, field.size);
  const slopes = yield* gradients(smooth, field.size);
  return { field, smoothed: smooth, gradients: slopes, borderBox: borderBox(field.voxels, field.size) };
}

/** The maps with their gradients, which are not kept once they are on the device. */
async function withGradients(maps: FieldMaps | null, signal: AbortSignal): Promise<FieldMaps | null> {
  if (!maps?.smoothed || maps.gradients.length > 0) return maps;
  return { ...maps, gradients: await patiently(gradients(maps.smoothed, maps.field.size), signal) };
}

function rendererOf(gl: Gl): string {
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  return String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
}
