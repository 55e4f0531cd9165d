// The graphics context of a surface: taken, lost, restored, and filled with what has been fetched.

import type { ReadyCase } from "../model/case.ts";
import { patiently } from "../base/patience.ts";
import type { Vec2 } from "../model/space.ts";
import type { Gl } from "../gl/gl.ts";
import { Painter } from "../gl/painter.ts";
import { fits, textureBytes } from "../gl/sizes.ts";
import type { PartName } from "../model/surfaces.ts";
import { withGradients, type Fetched, type PartFetched } from "./case-data.ts";

/** The most bytes on the device that a case may take. */
const MOST_TEXTURE_BYTES = 1 << 30;

const MOST_PICTURE_PIXELS = 8192;

/** Whether a case is small enough for any device. */
export const fitsMemory = (shown: ReadyCase): boolean =>
  textureBytes(shown.grid.size, shown.volume.size) <= MOST_TEXTURE_BYTES;

interface DeviceListener {
  lost(): void;
  restored(): void;
}

export class Device {
  readonly gl: Gl;
  readonly isSoftware: boolean;
  /** Null until it has all that has been fetched. */
  painter: Painter | null = null;
  readonly #canvas: HTMLCanvasElement;
  readonly #case: ReadyCase;
  readonly #listener: DeviceListener;
  /** Ends with the context: what was being brought to it is of no use to the next one. */
  #context = new AbortController();

  private constructor(canvas: HTMLCanvasElement, gl: Gl, shown: ReadyCase, listener: DeviceListener) {
    this.#canvas = canvas;
    this.gl = gl;
    this.#case = shown;
    this.#listener = listener;
    this.isSoftware = /swiftshader|llvmpipe|software/i.test(rendererOf(gl));
    canvas.addEventListener("webglcontextlost", this.#onLost);
    canvas.addEventListener("webglcontextrestored", this.#onRestored);
  }

  /** Takes a context of the canvas; null where there is none. */
  static take(canvas: HTMLCanvasElement, shown: ReadyCase, listener: DeviceListener): Device | null {
    const gl = canvas.getContext("webgl2", {
      alpha: false,
      antialias: false,
      depth: false,
      powerPreference: "high-performance",
    });
    return gl && new Device(canvas, gl, shown, listener);
  }

  /** The most pixels to a CSS pixel that a picture of so many CSS pixels can have here. */
  mostPixels(css: Vec2): number {
    const [width, height] = this.gl.getParameter(this.gl.MAX_VIEWPORT_DIMS) as Int32Array;
    const most = this.gl.getParameter(this.gl.MAX_TEXTURE_SIZE) as number;
    // The mesh is drawn into depths of twice the size.
    return Math.min(width ?? most, height ?? most, most / 2, MOST_PICTURE_PIXELS) / Math.max(...css);
  }

  /** Whether a case fits. The volume is cropped to the envelope; before it comes, its native size bounds it. */
  get fits(): boolean {
    return fits(this.gl, [this.#case.grid.size, this.#case.volume.size]) && fitsMemory(this.#case);
  }

  /**
   * Makes a painter that has all that has been fetched, at first or after a lost context; false: this context ended.
   */
  async fill(fetched: Fetched, signal: AbortSignal): Promise<boolean> {
    if (!fetched.volume || this.gl.isContextLost()) return false;
    const context = this.#context.signal;
    try {
      this.painter = await this.#filled(fetched, AbortSignal.any([signal, context]));
      return true;
    } catch (error) {
      // The next context begins again.
      if (context.aborted) return false;
      throw error;
    }
  }

  /** Brings something to the painter, if there is one; after a lost context it is brought with all the rest. */
  async bring(work: (painter: Painter) => Generator<void, void>, signal: AbortSignal): Promise<void> {
    const context = this.#context.signal;
    if (!this.painter) return;
    try {
      await patiently(work(this.painter), AbortSignal.any([signal, context]));
    } catch (error) {
      if (!context.aborted) throw error;
    }
  }

  dispose(): void {
    this.#canvas.removeEventListener("webglcontextlost", this.#onLost);
    this.#canvas.removeEventListener("webglcontextrestored", this.#onRestored);
    // A page may hold few contexts: this one is given back at once.
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
    this.painter = null;
  }

  async #filled(fetched: Fetched, signal: AbortSignal): Promise<Painter> {
    const native_spacing_mm = Math.min(...this.#case.volume.spacing_mm);
    const { envelope_sphere: sphere, cuts = [], grid } = this.#case;
    const painter = new Painter(this.gl, {
      sphere,
      plane: this.#case.midsagittal,
      native_spacing_mm,
      cuts,
      spacing_mm: grid.spacing_mm,
    });
    let taken: Fetched;
    do {
      taken = { ...fetched, parts: new Map(fetched.parts) };
      const field = await withGradients(taken.field, signal);
      const parts = new Map<PartName, PartFetched>();
      for (const [name, part] of taken.parts) {
        parts.set(name, { ...part, field: await withGradients(part.field, signal) });
      }
      await patiently(handOver(painter, { ...taken, field, parts }), signal);
      // What came meanwhile is brought as well.
    } while (
      taken.paths !== fetched.paths ||
      taken.volume !== fetched.volume ||
      taken.field !== fetched.field ||
      [...fetched.parts].some(([name, part]) => taken.parts.get(name) !== part)
    );
    signal.throwIfAborted();
    return painter;
  }

  readonly #onLost = (event: Event): void => {
    // Without this, the context would never come back.
    event.preventDefault();
    this.painter = null;
    this.#context.abort();
    this.#context = new AbortController();
    this.#listener.lost();
  };

  readonly #onRestored = (): void => this.#listener.restored();
}

/** Hands over what has been fetched, or a part of it. */
export function* handOver(painter: Painter, part: Partial<Fetched>): Generator<void, void> {
  const { triangles, positions, paths, volume, isWhole = false, field, parts = [] } = part;
  if (triangles) painter.setTriangles(triangles);
  if (positions) painter.setPositions(positions.positions, positions.depth_mm);
  if (paths) painter.setPaths(paths);
  if (volume) yield* painter.setVolume(volume, isWhole);
  if (field) yield* painter.setField(field);
  for (const [surface, one] of parts) {
    if (one.field) yield* painter.setField(one.field, surface);
    if (one.paths) painter.setPaths(one.paths, surface);
  }
}

function rendererOf(gl: Gl): string {
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  return String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
}
