// What is fetched of a case for its surface: first what the first picture needs, then the rest.

import { borderBox, gradients, smoothed } from "../model/field.ts";
import type { ReadyCase } from "../model/case.ts";
import type { PartName } from "../model/surfaces.ts";
import { unfenced, voxelCount, type Block, type PathsTable } from "../model/wire.ts";
import { patiently } from "../base/patience.ts";
import type { FieldMaps } from "../gl/scene.ts";
import { Assets, ByteCount, COARSE_STEP } from "./assets.ts";
import type { LoadProgress, SharedVolume } from "../store/surface.ts";

/** The most bytes of a whole volume that the page holds; slices of a larger one are the server's. */
const MOST_WHOLE_BYTES = 96 << 20;

export type Voxels8Or16 = Block<Uint8Array<ArrayBuffer> | Uint16Array<ArrayBuffer>>;

/** What has been fetched of a case, with which a device draws; a lost context is filled from it again. */
export interface Fetched {
  triangles: Uint32Array<ArrayBuffer> | null;
  positions: { readonly positions: Float32Array<ArrayBuffer>; readonly depth_mm: number } | null;
  paths: PathsTable | null;
  volume: Voxels8Or16 | null;
  /** Whether the volume is all that was acquired. */
  isWhole: boolean;
  field: FieldMaps | null;
  /** The surfaces of parts of the brain that were asked for. */
  readonly parts: Map<PartName, PartFetched>;
}

/** What has been fetched of the surface of a part. */
export interface PartFetched {
  readonly field: FieldMaps | null;
  readonly paths: PathsTable | null;
}

/** Gets the data as they arrive. `CaseData` waits for what takes long. */
interface DataListener {
  /** All of the first picture is here. */
  first(signal: AbortSignal): Promise<void>;
  /** More is here for a device. */
  more(part: Partial<Fetched>, signal: AbortSignal): Promise<void>;
  whole(volume: Voxels8Or16, maps: FieldMaps): void;
}

export class CaseData {
  readonly fetched: Fetched = {
    triangles: null,
    positions: null,
    paths: null,
    volume: null,
    isWhole: false,
    field: null,
    parts: new Map(),
  };
  readonly #case: ReadyCase;
  readonly #gone: AbortSignal;
  readonly #listener: DataListener;
  /** Fetches the positions of a depth while there is no table of all depths. */
  #fetchPositions: ((depth_mm: number) => void) | null = null;

  constructor(shown: ReadyCase, gone: AbortSignal, listener: DataListener) {
    this.#case = shown;
    this.#gone = gone;
    this.#listener = listener;
  }

  /** Whether the first picture's data have come, so that other depths can be asked for. */
  get hasFirst(): boolean {
    return this.#fetchPositions !== null;
  }

  /** Asks for the mesh of a depth, until the table of all depths is here. */
  wantDepth(depth_mm: number): void {
    this.#fetchPositions?.(depth_mm);
  }

  /** Fetches everything; without `draws` only what points are found with. Asked for again, the rest alone. */
  async load(
    depth_mm: number,
    draws: boolean,
    signal: AbortSignal,
    hear: (progress: LoadProgress) => void,
  ): Promise<void> {
    const count = new ByteCount(hear);
    const assets = new Assets(this.#case.id, signal, count);
    if (draws && !this.hasFirst) await this.#loadFirst(assets, depth_mm, signal);
    count.enter("rest");
    await this.#loadRest(assets, draws, signal, () => count.enter("ready"));
  }

  /** Reads what a file holds: nothing is drawn before all of it is here, and no mesh is needed. */
  async loadShared(
    { bits, extent }: SharedVolume,
    signal: AbortSignal,
    hear: (progress: LoadProgress) => void,
  ): Promise<void> {
    const assets = new Assets(this.#case.id, signal, new ByteCount(() => {}));
    hear({ stage: "ready", loaded: 0, total: 0 });
    const [volume, field] = await Promise.all([assets.volume(bits, extent), assets.distance("all")]);
    const made = await patiently(fieldMaps(field), signal);
    // Slices show all that the file has.
    Object.assign(this.fetched, { volume, isWhole: true, field: made });
    await this.#listener.first(signal);
    this.fetched.field = { ...made, gradients: new Int8Array() };
    this.#listener.whole(volume, made);
  }

  /** Fetches all that was acquired, in the place of what lies around the brain; it is null if that is too much. */
  async loadWhole(): Promise<Voxels8Or16 | null> {
    const bytes = 2 * voxelCount(this.#case.volume.size);
    if (bytes > MOST_WHOLE_BYTES) return null;
    const assets = new Assets(this.#case.id, this.#gone, new ByteCount(() => {}));
    const whole = await assets.volume(16, "whole");
    await this.#take({ volume: whole, isWhole: true }, this.#gone);
    return whole;
  }

  /** Fetches the surface of a part; the volume is that of the whole brain. Its mesh follows, for it is not drawn at rest. */
  async loadPart(surface: PartName): Promise<FieldMaps> {
    const assets = new Assets(this.#case.id, this.#gone, new ByteCount(() => {}), surface);
    const coded = await assets.distance("all");
    const made = await patiently(partMaps(coded), this.#gone);
    await this.#listener.more({ parts: new Map([[surface, { field: made, paths: null }]]) }, this.#gone);
    // The gradients are on the device, as of the whole brain.
    const field = { ...made, gradients: new Int8Array() };
    this.fetched.parts.set(surface, { field, paths: null });
    const follow = async (): Promise<void> => {
      const paths = await assets.paths();
      this.fetched.parts.set(surface, { field, paths });
      await this.#listener.more({ parts: new Map([[surface, { field: null, paths }]]) }, this.#gone);
    };
    // Without its mesh it is drawn exactly, however slow the device is.
    follow().catch(() => {});
    return field;
  }

  #take(part: Partial<Fetched>, signal: AbortSignal): Promise<void> {
    Object.assign(this.fetched, part);
    return this.#listener.more(part, signal);
  }

  async #loadFirst(assets: Assets, depth_mm: number, signal: AbortSignal): Promise<void> {
    const [triangles, positions, quick, coarse] = await Promise.all([
      assets.triangles(),
      assets.positions(depth_mm),
      assets.volume(8),
      assets.distance("coarse"),
    ]);
    Object.assign(this.fetched, { triangles, positions: { positions, depth_mm }, volume: quick });
    this.fetched.field = await patiently(coarseMaps(coarse), signal);
    await this.#listener.first(signal);
    // Other depths are wanted even when the table of all of them was cancelled.
    this.#fetchPositions = this.#positionsFetcher(new Assets(this.#case.id, this.#gone, new ByteCount(() => {})));
  }

  /** One request at a time, of the latest depth. */
  #positionsFetcher(assets: Assets): (depth_mm: number) => void {
    let isRunning = false;
    let wanted: number | null = null;
    const run = async (): Promise<void> => {
      isRunning = true;
      for (; wanted !== null && !this.fetched.paths;) {
        const depth_mm = wanted;
        wanted = null;
        const positions = await assets.positions(depth_mm);
        await this.#take({ positions: { positions, depth_mm } }, this.#gone);
      }
      isRunning = false;
    };
    return (depth_mm) => {
      wanted = depth_mm;
      // The table of all depths follows; what goes wrong with it is said.
      if (!isRunning) run().catch(() => (isRunning = false));
    };
  }

  /** `come` is called when everything has come, and is made ready. */
  async #loadRest(assets: Assets, draws: boolean, signal: AbortSignal, come: () => void): Promise<void> {
    let missing = draws ? 3 : 2;
    const arrived = <Part>(part: Part): Part => {
      missing -= 1;
      if (missing === 0) come();
      return part;
    };
    const table = async (): Promise<void> => {
      if (!draws) return;
      await this.#take({ paths: arrived(await assets.paths()) }, signal);
    };
    const volume = async (): Promise<Voxels8Or16> => {
      const whole = arrived(await assets.volume(16));
      await this.#take({ volume: whole, isWhole: false }, signal);
      return whole;
    };
    const maps = async (): Promise<FieldMaps> => {
      const field = arrived(await assets.distance("all"));
      const made = await patiently(fieldMaps(field), signal);
      await this.#take({ field: made }, signal);
      return made;
    };
    const [whole, made] = await Promise.all([volume(), maps(), table()]);
    // The gradients are on the device; after a lost context they are made again.
    this.fetched.field = { ...made, gradients: new Int8Array() };
    this.#listener.whole(whole, made);
  }
}

/** Only the light, from depths at every `COARSE_STEP`th voxel. */
function* coarseMaps(field: Block<Int16Array<ArrayBuffer>>): Generator<void, FieldMaps> {
  return { field, smoothed: null, gradients: yield* gradients(field.voxels, field.size, COARSE_STEP), borderBox: null };
}

/** All that is made of the depths; of a part, with its fence. */
function* fieldMaps(
  field: Block<Int16Array<ArrayBuffer>>,
  fenced: Uint8Array<ArrayBuffer> | null = null,
): Generator<void, FieldMaps> {
  const smooth = yield* smoothed(field.voxels, field.size);
  const slopes = yield* gradients(smooth, field.size, undefined, fenced);
  return { field, smoothed: smooth, gradients: slopes, borderBox: borderBox(field.voxels, field.size), fenced };
}

function* partMaps(coded: Block<Int16Array<ArrayBuffer>>): Generator<void, FieldMaps> {
  const { field, fenced } = yield* unfenced(coded);
  return yield* fieldMaps(field, fenced);
}

/** The maps with their gradients, which are not kept once they are on the device. */
export async function withGradients(maps: FieldMaps | null, signal: AbortSignal): Promise<FieldMaps | null> {
  if (!maps?.smoothed || maps.gradients.length > 0) return maps;
  const { field, smoothed: smooth, fenced = null } = maps;
  return { ...maps, gradients: await patiently(gradients(smooth, field.size, undefined, fenced), signal) };
}
