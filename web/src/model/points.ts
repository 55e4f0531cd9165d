// Single points of a case's surface, found on the processor.

import { mirrored, project, towardsViewer } from "./camera.ts";
import type { ReadyCase } from "./case.ts";
import { type Depths, type Ray, firstHit } from "./isosurface.ts";
import { reflected } from "./midsagittal.ts";
import { type Profile, profileAt } from "./profile.ts";
import type { Sampler } from "./sampler.ts";
import { type Vec2, type Vec3, dot, length, normalized, scale, subtract, distance } from "./space.ts";
import { type ViewState, isHalved, isMirrored, isStacked, viewSize } from "./state.ts";

/** The point of the surface that is seen at a place of the pane. */
export interface Picked {
  readonly position_in_patient: Vec3;
  readonly depth_mm: number;
  /** Null where it is not known (yet). */
  readonly intensity: number | null;
  /** Whether it was seen in the half that shows the head mirrored. */
  readonly isFlipped: boolean;
}

export interface Probed {
  /** NaN beside a cut through the brain or a fence, where it is unknown. */
  readonly depth_mm: number;
  readonly intensity: number;
}

/** How near to a cut voxels are unknown at any depth, in voxels. */
export const CUT_REACH = 1.5;

/** Whether a depth at a position is known: it is not if a face that cuts the brain is nearer than any dura. */
const isKnown = ({ cuts = [], grid }: ReadyCase, position: Vec3, depth_mm: number): boolean =>
  cuts.every(({ normal, offset_mm }) => dot(normal, position) - offset_mm >= depth_mm + CUT_REACH * grid.spacing_mm);

/** What lies so far outside the envelope is beside the head: bone and skin are about half as thick. */
const HEAD_MM = 25;
/** So far outside the envelope no way into the brain belongs to a point. */
const OUTSIDE_MM = 2;

/** How far before the envelope's sphere a line of sight begins. */
const MARGIN_MM = 10;

export class Points {
  readonly #case: ReadyCase;
  readonly depths: Depths;
  readonly #volume: Sampler;

  constructor(shown: ReadyCase, depths: Depths, volume: Sampler) {
    this.#case = shown;
    this.depths = depths;
    this.#volume = volume;
  }

  /**
   * What is seen at a place of a pane of `size`, of which each half can be a view; else null. `other` are the points of the surface
   * in the mirrored half.
   */
  pick(state: ViewState, [x, y]: Vec2, pane: Vec2, other: Points = this): Picked | null {
    const sphere = this.#case.envelope_sphere;
    const size = viewSize(state, pane);
    const stacked = isStacked(state, pane);
    const isOther = isHalved(state) && (stacked ? y >= size[1] : x >= size[0]);
    const [column, row] = !isOther ? [x, y] : stacked ? [x, y - size[1]] : [x - size[0], y];
    const isMirror = isOther && isMirrored(state);
    if (isMirror && other !== this) return other.pick(state, [x, y], pane);
    const view = isMirror ? mirrored(state, this.#case.midsagittal, sphere) : state;
    const place: Vec2 = [isMirror ? size[0] - column : column, row];
    const reach_mm = sphere.radius_mm + MARGIN_MM;
    const from = project(view, sphere, size).positionOf([...place, reach_mm]);
    const direction = scale(towardsViewer(view.orientation), -1);
    const position = this.met({ from, direction, reach_mm: 2 * reach_mm }, state.depth_mm);
    if (!position) return null;
    const intensity = this.#volume.atPatient(position);
    return {
      position_in_patient: position,
      depth_mm: state.depth_mm,
      intensity: Number.isNaN(intensity) ? null : intensity,
      isFlipped: isMirror,
    };
  }

  /** Where a ray first meets the isosurface; null where it does not, or where that is unknown. */
  met(ray: Ray, depth_mm: number): Vec3 | null {
    const position = firstHit(this.depths, ray, depth_mm);
    return position && this.#isKnown(position, depth_mm) ? position : null;
  }

  /** Whether a position is within the head, as far as the envelope tells. */
  isInHead(position: Vec3): boolean {
    const inwards = subtract(this.#case.envelope_sphere.center_in_patient, position);
    const direction = normalized(inwards);
    const border = firstHit(this.depths, { from: position, direction, reach_mm: length(inwards) }, 0);
    return border !== null && distance(border, position) <= HEAD_MM;
  }

  /** Null outside the envelope. */
  profile(position: Vec3): Profile | null {
    if (this.depths.depthAt(position) < -OUTSIDE_MM) return null;
    const volume = {
      atPatient: (place: Vec3) => (Number.isNaN(this.#depthAt(place)) ? NaN : this.#volume.atPatient(place)),
    };
    return profileAt(this.depths, volume, position, reflected(position, this.#case.midsagittal));
  }

  probe(position: Vec3): Probed {
    return { depth_mm: this.#depthAt(position), intensity: this.#volume.atPatient(position) };
  }

  /** The depth at a position; NaN where it is unknown. */
  #depthAt(position: Vec3): number {
    const depth_mm = this.depths.depthAt(position);
    return this.#isKnown(position, depth_mm) ? depth_mm : NaN;
  }

  #isKnown(position: Vec3, depth_mm: number): boolean {
    return isKnown(this.#case, position, depth_mm) && !this.depths.isFenced?.(position);
  }
}
