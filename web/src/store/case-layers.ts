// What the server has of a case's layers: how far they are, their voxels, and the places that it lists.

import { signal } from "@preact/signals";

import { reasonIn } from "../base/case-words.ts";
import { t } from "../base/i18n.ts";
import { wait } from "../base/patience.ts";
import { Problem, getCandidates, listLayers, send } from "../base/api.ts";
import { type Layer, type LayerList, isBusy, isReady } from "../model/layers.ts";
import type { CandidateList, ListingMap } from "../model/maps.ts";
import { layerSampler } from "../model/sampler.ts";
import { MOST_SHOWN } from "../model/state.ts";
import type { Vec3 } from "../model/space.ts";
import { AGAIN_MS, isFinal } from "./sync.ts";
import { type Block, decodeVolume, readLayout } from "../model/wire.ts";

/** How long to wait before asking again while layers are being made, in ms. */
const WAIT_MS = 1000;
/** As many as are asked for. */
const CANDIDATES = 20;

export class CaseLayers {
  /** Null until the layers have been listed. */
  readonly list = signal<LayerList | null>(null);
  /** The layers whose voxels are here. */
  readonly here = signal<ReadonlySet<string>>(new Set());
  readonly #id: string;
  readonly #gone = new AbortController();
  readonly #voxels = new Map<string, Promise<Block>>();
  /** Those of them that are here. */
  readonly #samplers = new Map<string, (position_in_patient: Vec3) => number>();
  #asking: Promise<void> | null = null;
  #isStale = false;

  constructor(id: string) {
    this.#id = id;
  }

  /** A layer that is ready, by the name of a map or the id of an added one. */
  ready(id: string): Layer | null {
    return this.list.value?.layers.find((one) => one.id === id && isReady(one)) ?? null;
  }

  /** Why a map cannot be shown, in words; empty: it can, or it is not known yet. */
  whyNone(map: string): string {
    const { state, reason = "", reason_code } = this.list.value?.layers.find(({ id }) => id === map) ?? {};
    if (state === "off") return t("maps.off");
    if (state !== "undefined") return "";
    return t(map === "flair" ? "flair.undefined" : "maps.undefined", { reason: reasonIn(reason, reason_code) });
  }

  get names(): readonly string[] {
    return this.list.value?.layers.map(({ name }) => name) ?? [];
  }

  /** Asks until no layer is being made. What is asked for already is asked for once. */
  ask(): Promise<void> {
    const list = this.list.peek();
    if (list && !list.layers.some(isBusy) && !this.#isStale) return Promise.resolve();
    return (this.#asking ??= this.#ask().finally(() => (this.#asking = null)));
  }

  /** Asks until the layers have been listed, also if the server does not answer at first. */
  async follow(): Promise<void> {
    while (!this.#gone.signal.aborted) {
      try {
        return await this.ask();
      } catch (problem) {
        if (isFinal(problem)) return;
        await wait(AGAIN_MS);
      }
    }
  }

  /** Asks again: something has changed. */
  async again(): Promise<void> {
    this.#isStale = true;
    // What is being asked may be of before.
    await this.#asking;
    await this.ask();
  }

  /** The voxels of a layer that is ready; fetched once. */
  voxels(name: string): Promise<Block> {
    const voxels = this.#voxels.get(name) ?? this.#fetch(name);
    this.#voxels.delete(name);
    this.#voxels.set(name, voxels);
    for (const old of [...this.#voxels.keys()].slice(0, -MOST_SHOWN)) this.forget(old);
    voxels.then(
      (block) => {
        if (!this.#voxels.has(name) || this.#samplers.has(name)) return;
        this.#samplers.set(name, layerSampler(block));
        this.here.value = new Set(this.#samplers.keys());
      },
      // A failed request is repeated.
      () => this.#voxels.delete(name),
    );
    return voxels;
  }

  /** Forgets the voxels of a layer, which may be others now. */
  forget(name: string): void {
    this.#voxels.delete(name);
    this.#samplers.delete(name);
  }

  /** The value of a layer at a position: NaN where it is undefined, nothing until its voxels are here. */
  valueAt(name: string, position_in_patient: Vec3): number | undefined {
    const value = this.#samplers.get(name)?.(position_in_patient);
    return this.ready(name)?.kind === "labels" ? undefined : value;
  }

  candidates(map: ListingMap): Promise<CandidateList> {
    return patiently(() => getCandidates(this.#id, CANDIDATES, map), this.#gone.signal);
  }

  dispose(): void {
    this.#gone.abort();
  }

  async #ask(): Promise<void> {
    for (;;) {
      this.#isStale = false;
      const list = await listLayers(this.#id);
      if (this.#gone.signal.aborted) return;
      this.list.value = list;
      if (this.#isStale) continue;
      if (!list.layers.some(isBusy)) return;
      await wait(WAIT_MS);
    }
  }

  async #fetch(name: string): Promise<Block> {
    const { signal } = this.#gone;
    const path = `v1/cases/${this.#id}/layers/${name}/volume`;
    const answer = await patiently(() => send(path, { signal }), signal);
    return decodeVolume(await answer.arrayBuffer(), readLayout(answer.headers));
  }
}

/** Asks again as long as the layer is being made: it may be lost, and made once more. */
export async function patiently<T>(ask: () => Promise<T>, signal: AbortSignal): Promise<T> {
  for (;;) {
    try {
      return await ask();
    } catch (problem) {
      const isMaking = problem instanceof Problem && problem.kind === "layer-not-ready";
      if (!isMaking || signal.aborted) throw problem;
      await wait(1000 * problem.retryAfter || WAIT_MS);
    }
  }
}
