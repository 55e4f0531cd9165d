// Where a place of the patient is at another depth: along the way in from the envelope, up and down the gradient.

import type { Depths } from "./isosurface.ts";
import { type Vec3, add, length, scale, subtract } from "./space.ts";

/** A step of a walk, in voxels. */
const STEP = 0.25;
/** So near to a depth is at it, in voxels. */
const NEAR = 0.005;
/** A walk that gets less than this share of its step nearer has come to a ridge, or to the middle. */
const STALLED = 0.2;
const MOST_STEPS = 4096;

/** A walk from a position towards a depth, and the depths on its way. */
interface Walk {
  readonly points: readonly Vec3[];
  readonly depths_mm: readonly number[];
}

/**
 * Along the gradient of the smoothed depth from a position to a depth, or as far as it leads. A step is that of Heun:
 * along the mean of the directions where it begins and where it would end.
 */
function walked(depths: Depths, position: Vec3, depth_mm: number): Walk {
  const { voxel_mm } = depths;
  const points: Vec3[] = [position];
  const depths_mm = [depths.depthAt(position)];
  let [here, depth] = [position, depths_mm[0] ?? NaN];
  let stalls = 0;
  for (let rounds = 0; rounds < MOST_STEPS && stalls < 8; rounds += 1) {
    const left = depth_mm - depth;
    if (!(Math.abs(left) > NEAR * voxel_mm)) break;
    const step = Math.sign(left) * Math.min(Math.abs(left), STEP * voxel_mm);
    const first = depths.inwardAt(here);
    const second = depths.inwardAt(add(here, scale(first, step)));
    const both = add(first, second);
    if (length(both) < 1e-6) break;
    const next = add(here, scale(both, step / length(both)));
    const reached = depths.depthAt(next);
    stalls = (reached - depth) * Math.sign(step) > STALLED * Math.abs(step) ? 0 : stalls + 1;
    [here, depth] = [next, reached];
    points.push(here);
    depths_mm.push(depth);
  }
  return { points, depths_mm };
}

/** Where a position is at another depth: as near to it as the way through it leads. */
export const slidTo = (depths: Depths, position: Vec3, depth_mm: number): Vec3 =>
  walked(depths, position, depth_mm).points.at(-1) ?? position;

/** A walk as it is kept, for there may be thousands: four numbers a step, the position and its depth. */
const tableOf = ({ points, depths_mm }: Walk): Float32Array =>
  Float32Array.from(points.flatMap((point, at) => [...point, depths_mm[at] ?? NaN]));

/** The way through a position, as tables: where it is at each depth. */
class Flow {
  readonly #outward: Float32Array;
  readonly #inward: Float32Array;
  readonly #own: Vec3;

  constructor(depths: Depths, position: Vec3, deepest_mm: number) {
    this.#own = position;
    this.#outward = tableOf(walked(depths, position, 0));
    this.#inward = tableOf(walked(depths, position, deepest_mm));
  }

  /** The point of the way at a depth; its end where it does not lead so far. */
  at(depth_mm: number): Vec3 {
    const own = this.#inward[3] ?? NaN;
    // Also a position outside of the field has a place.
    if (!Number.isFinite(own)) return this.#own;
    const [table, sign] = depth_mm < own ? [this.#outward, -1] : [this.#inward, 1];
    const number = (step: number, part: number): number => table[4 * step + part] ?? NaN;
    const point = (step: number): Vec3 => [number(step, 0), number(step, 1), number(step, 2)];
    const last = table.length / 4 - 1;
    let after = 0;
    while (after < last && (number(after, 3) - depth_mm) * sign < 0) after += 1;
    if (after === 0) return this.#own;
    const share = (depth_mm - number(after - 1, 3)) / (number(after, 3) - number(after - 1, 3));
    if (!(share < 1)) return point(after);
    return add(point(after - 1), scale(subtract(point(after), point(after - 1)), share));
  }
}

/** Keeps the ways through positions: each is walked once. */
export class Flows {
  readonly depths: Depths;
  readonly #deepest_mm: number;
  readonly #flows = new Map<string, Flow>();
  /** The same by the values themselves, which are asked for again and again. */
  readonly #known = new WeakMap<Vec3, Flow>();

  constructor(depths: Depths, deepest_mm: number) {
    this.depths = depths;
    this.#deepest_mm = deepest_mm;
  }

  /** Whether the way through a position has been walked. */
  has(position: Vec3): boolean {
    return this.#known.has(position) || this.#flows.has(position.join());
  }

  at(position: Vec3, depth_mm: number): Vec3 {
    return (this.#known.get(position) ?? this.#walked(position)).at(depth_mm);
  }

  #walked(position: Vec3): Flow {
    const key = position.join();
    const flow = this.#flows.get(key) ?? new Flow(this.depths, position, this.#deepest_mm);
    this.#flows.set(key, flow);
    this.#known.set(position, flow);
    return flow;
  }
}
