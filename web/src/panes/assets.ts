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
  pathsLength,
  readLayout,
  refuseUnless,
  triangleCount,
  vertexCount,
  type Block,
  type PathsTable,
} from "../model/wire.ts";

/** The step of the depths that is fine enough for the light of the first picture. */
export const COARSE_STEP = 4;

/** Adds up the bytes of the requests of a stage. The total is known once all of them know theirs. */
export class ByteCount {
  readonly #hear: (progress: LoadProgress) => void;
  #stage: LoadProgress["stage"] = "first";
  #counts: { loaded: number; total: number | null }[] = [];

  constructor(hear: (progress: LoadProgress) => void) {
    this.#hear = hear;
  }

  /** A further request; what is returned hears how many bytes have come, of how many. */
  begin(): (loaded: number, total: number | null) => void {
    const count: { loaded: number; total: number | null } = { loaded: 0, total: null };
    this.#counts.push(count);
    this.#tell();
    return (loaded, total) => {
      Object.assign(count, { loaded, total });
      this.#tell();
    };
  }

  /** What is done from now on. */
  enter(stage: LoadProgress["stage"]): void {
    this.#stage = stage;
    this.#counts = [];
    this.#tell();
  }

  #tell(): void {
    let [loaded, total] = [0, 0];
    for (const count of this.#counts) {
      loaded += count.loaded;
      total += count.total ?? NaN;
    }
    this.#hear({ stage: this.#stage, loaded, total: total || 0 });
  }
}

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
    const path = `mesh/paths?${MESH_QUERY}&${MESH_PATHS}${this.#ofSurface}`;
    const { bytes } = await this.#get(path, null, pathsLength);
    const table = decodePaths(bytes);
    refuseUnless(vertexCount(table.mesh) === vertexCount(PAGE_MESH));
    return table;
  }

  /** The intensities in 8 bits, for a first picture, or as they were acquired: those around the brain, or all. */
  async volume(
    bits: 8 | 16,
    extent: "envelope" | "whole" = "envelope",
  ): Promise<Block<Uint8Array<ArrayBuffer> | Uint16Array<ArrayBuffer>>> {
    const { bytes, headers } = await this.#get(`volume?bits=${bits}&extent=${extent}`);
    return decodeVolume(bytes, readLayout(headers));
  }

  /** The depths: `coarse` for the light of a first picture, or all. */
  async distance(extent: "coarse" | "all"): Promise<Block<Int16Array<ArrayBuffer>>> {
    const step = extent === "coarse" ? COARSE_STEP : 1;
    const query = step > 1 ? `?step=${step}` : this.#ofSurface.replace("&", "?");
    const { bytes, headers } = await this.#get(`distance${query}`);
    return decodeDistance(bytes, readLayout(headers));
  }

  /** The answer, of `length` bytes, or of as many as its headers or its beginning state. */
  async #get(
    path: string,
    length: number | null = null,
    lengthOf: (beginning: DataView) => number | null = () => null,
  ): Promise<{ readonly bytes: ArrayBuffer; readonly headers: Headers }> {
    const hear = this.#count.begin();
    const response = await send(`v1/cases/${this.#id}/${path}`, { signal: this.#signal });
    const { headers } = response;
    const bytes = await readAll(response, length ?? bodyLength(headers), lengthOf, hear);
    return { bytes, headers };
  }
}

/** The bytes of a body as the page reads it; null where they are not known beforehand. */
function bodyLength(headers: Headers): number | null {
  if (headers.has("x-isocortex-size")) return byteLength(readLayout(headers));
  const length = Number(headers.get("content-length"));
  return !headers.has("content-encoding") && length > 0 ? length : null;
}

/** A body as one buffer; what is known of its length saves copies where it is right, and is no promise. */
async function readAll(
  response: Response,
  known: number | null,
  lengthOf: (beginning: DataView) => number | null,
  hear: (loaded: number, total: number | null) => void,
): Promise<ArrayBuffer> {
  const reader = response.body?.getReader();
  if (!reader) return response.arrayBuffer();
  const most = 1 << 30;
  let total = known;
  let room = new Uint8Array(Math.min(total ?? 1 << 16, most));
  let length = 0;
  for (;;) {
    hear(length, total);
    const { done, value } = await reader.read();
    if (done) break;
    total ??= lengthOf(new DataView(value.buffer, value.byteOffset, value.byteLength));
    const needed = Math.max(length + value.length, total ?? 0);
    if (needed > room.length) {
      refuseUnless(needed <= most);
      const wider = new Uint8Array(Math.min(most, Math.max(2 * room.length, needed)));
      wider.set(room.subarray(0, length));
      room = wider;
    }
    room.set(value, length);
    length += value.length;
  }
  return length === room.length ? room.buffer : room.buffer.slice(0, length);
}
