// What the server has of a case's maps: how far they are, their voxels, and the places that it lists.

import { Problem, getCandidates, getCase, send } from "../base/api.ts";
import type { Candidate, MapName, MapsState } from "../model/maps.ts";
import { type Block, decodeVolume, readLayout } from "../model/wire.ts";

/** How long to wait before asking again for maps that are being made, in ms. */
const WAIT_MS = 1000;
/** As many as are asked for. */
const CANDIDATES = 20;

export class CaseMaps {
  readonly #id: string;
  readonly #gone = new AbortController();
  readonly #hear: (state: MapsState) => void;
  readonly #layers = new Map<MapName, Promise<Block>>();
  #isReady = false;
  #asking: Promise<void> | null = null;

  /** `hear` is told how far the maps are, whenever that changes. */
  constructor(id: string, hear: (state: MapsState) => void) {
    this.#id = id;
    this.#hear = hear;
  }

  get isReady(): boolean {
    return this.#isReady;
  }

  /** Asks until the maps are ready, or there are none. What is asked for already is asked for once. */
  ask(): Promise<void> {
    if (this.#isReady) return Promise.resolve();
    return (this.#asking ??= this.#ask().finally(() => (this.#asking = null)));
  }

  /** The voxels of a map that is ready; fetched once. */
  layer(name: MapName): Promise<Block> {
    const layer = this.#layers.get(name) ?? this.#fetch(name);
    this.#layers.set(name, layer);
    // What could not be had is asked for again.
    layer.catch(() => this.#layers.delete(name));
    return layer;
  }

  candidates(): Promise<readonly Candidate[]> {
    return this.#patiently(() => getCandidates(this.#id, CANDIDATES));
  }

  dispose(): void {
    this.#gone.abort();
  }

  async #ask(): Promise<void> {
    for (;;) {
      const found = await getCase(this.#id);
      if (this.#gone.signal.aborted) return;
      const maps = found.state === "ready" ? found.maps : undefined;
      if (!maps) throw new Problem(0, "layer-not-ready", "");
      this.#isReady = maps.state === "ready";
      this.#hear(maps);
      if (maps.state !== "making") return;
      await wait(WAIT_MS);
    }
  }

  async #fetch(name: MapName): Promise<Block> {
    const { signal } = this.#gone;
    const path = `v1/cases/${this.#id}/layers/${name}/volume`;
    const answer = await this.#patiently(() => send(path, { signal }));
    return decodeVolume(await answer.arrayBuffer(), readLayout(answer.headers));
  }

  /** Asks again as long as the maps are being made: they may be lost, and made once more. */
  async #patiently<T>(ask: () => Promise<T>): Promise<T> {
    for (;;) {
      try {
        return await ask();
      } catch (problem) {
        const isMaking = problem instanceof Problem && problem.kind === "layer-not-ready";
        if (!isMaking || this.#gone.signal.aborted) throw problem;
        await wait(1000 * problem.retryAfter || WAIT_MS);
      }
    }
  }
}

const wait = (time_ms: number): Promise<void> => new Promise((resolve) => setTimeout(resolve, time_ms));
