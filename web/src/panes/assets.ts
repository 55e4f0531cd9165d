// Fetches what the page draws with, and counts the bytes.

import { send } from "../base/api.ts";
import { MESH_PATHS, MESH_QUERY, PAGE_MESH } from "../model/query.ts";
import type { SurfaceName } from "../model/surfaces.ts";
import type { LoadProgress } from "../store/surface.ts";
import {
  byteLength,
  decodeDistance,
  decodePaths,
  decodePositions,
  decodeTriangles,
  decodeVolume,
  readLayout,
  refuseUnless,
  triangleCount,
  vertexCount,
  type Block,
  type PathsTable,
} from "../model/wire.ts";

/** The step of the depths that is fine enough for the light of the first picture. */
export const COARSE_STEP = 4;

/** Adds up the bytes of several requests. Until a request has answered it counts as many as it is thought to have. */
export class ByteCount {
  readonly #hear: (progress: LoadProgress) => void;
  #stage: LoadProgress["stage"] = "first";
  readonly #counts: { loaded: number; total: number }[] = [];

  constructor(hear: (progress: LoadProgress) => void) {
    this.#hear = hear;
  }

  /** A further request, of about `total` bytes. */
  begin(total: number): { total(bytes: number): void; add(bytes: number): void } {
    const count = { loaded: 0, total };
    this.#counts.push(count);
    this.#tell();
    return {
      total: (bytes) => {
        count.total = bytes;
        this.#tell();
      },
      add: (bytes) => {
        count.loaded += bytes;
        count.total = Math.max(count.total, count.loaded);
        this.#tell();
      },
    };
  }

  /** What is done from now on. */
  enter(stage: LoadProgress["stage"]): void {
    this.#stage = stage;
    this.#tell();
  }

  #tell(): void {
    const sum = (part: "loaded" | "total"): number => this.#counts.reduce((before, count) => before + count[part], 0);
    this.#hear({ stage: this.#stage, loaded: sum("loaded"), total: sum("total") });
  }
}

/** Fetches the assets of a case. */
export class Assets {
  readonly #id: string;
  readonly #signal: AbortSignal;
  readonly #count: ByteCount;
  /** What queries about one of the case's surfaces end with. */
  readonly #ofSurface: string;

  constructor(id: string, signal: AbortSignal, count: ByteCount, surface: SurfaceName = "whole") {
    this.#id = id;
    this.#signal = signal;
    this.#count = count;
    this.#ofSurface = surface === "whole" ? "" : `&surface=${surface}`;
  }

  /** Three vertex numbers for each triangle of the page's mesh. */
  async triangles(): Promise<Uint32Array<ArrayBuffer>> {
    const { bytes } = await this.#get(`mesh/triangles?${MESH_QUERY}`, 12 * triangleCount(PAGE_MESH));
    return decodeTriangles(bytes, PAGE_MESH);
  }

  /** The vertices of the page's mesh at one depth. */
  async positions(depth_mm: number): Promise<Float32Array<ArrayBuffer>> {
    const { bytes } = await this.#get(
      `mesh?depth_mm=${depth_mm}&${MESH_QUERY}&${MESH_PATHS}${this.#ofSurface}`,
      12 * vertexCount(PAGE_MESH),
    );
    return decodePositions(bytes, PAGE_MESH);
  }

  /** The same at every depth. */
  async paths(): Promise<PathsTable> {
    const guess = 1000 * vertexCount(PAGE_MESH);
    const { bytes } = await this.#get(`mesh/paths?${MESH_QUERY}&${MESH_PATHS}${this.#ofSurface}`, guess);
    const table = decodePaths(bytes);
    refuseUnless(vertexCount(table.mesh) === vertexCount(PAGE_MESH));
    return table;
  }

  /** The intensities in 8 bits, for a first picture, or as they were acquired: those around the brain, or all. */
  async volume(
    bits: 8 | 16,
    guess: number,
    extent: "envelope" | "whole" = "envelope",
  ): Promise<Block<Uint8Array<ArrayBuffer> | Uint16Array<ArrayBuffer>>> {
    const { bytes, headers } = await this.#get(`volume?bits=${bits}&extent=${extent}`, guess);
    return decodeVolume(bytes, readLayout(headers));
  }

  /** The depths: `coarse` for the light of a first picture, or all. */
  async distance(extent: "coarse" | "all", guess: number): Promise<Block<Int16Array<ArrayBuffer>>> {
    const step = extent === "coarse" ? COARSE_STEP : 1;
    const query = step > 1 ? `?step=${step}` : this.#ofSurface.replace("&", "?");
    const { bytes, headers } = await this.#get(`distance${query}`, guess);
    return decodeDistance(bytes, readLayout(headers));
  }

  async #get(path: string, guess: number): Promise<{ readonly bytes: ArrayBuffer; readonly headers: Headers }> {
    const count = this.#count.begin(guess);
    const response = await send(`v1/cases/${this.#id}/${path}`, { signal: this.#signal });
    const { headers } = response;
    const length = bodyLength(headers);
    if (length !== null) count.total(length);
    const bytes = await readAll(response, length ?? guess, (read) => count.add(read));
    return { bytes, headers };
  }
}

/** The bytes of a body as the page reads it; null where they are not known beforehand. */
function bodyLength(headers: Headers): number | null {
  if (headers.has("x-isocortex-size")) return byteLength(readLayout(headers));
  const length = Number(headers.get("content-length"));
  return !headers.has("content-encoding") && length > 0 ? length : null;
}

/** A body as one buffer. `guess` saves copies where it is right, and is no promise. */
async function readAll(response: Response, guess: number, hear: (bytes: number) => void): Promise<ArrayBuffer> {
  const reader = response.body?.getReader();
  if (!reader) return response.arrayBuffer();
  const most = 1 << 30;
  let room = new Uint8Array(Math.min(Math.max(guess, 1 << 10), most));
  let length = 0;
  for (;;) {
    const { done, value } = await reader.read();
    if (done) break;
    if (length + value.length > room.length) {
      refuseUnless(length + value.length <= most);
      const wider = new Uint8Array(Math.min(most, Math.max(2 * room.length, length + value.length)));
      wider.set(room.subarray(0, length));
      room = wider;
    }
    room.set(value, length);
    length += value.length;
    hear(value.length);
  }
  return length === room.length ? room.buffer : room.buffer.slice(0, length);
}
