// The plane across a sulcus: how it lies in the patient, and its traces in other slices. Pure.

import { parsed } from "./text.ts";
import type { View } from "./camera.ts";
import type { Sphere } from "./case.ts";
import {
  type Quat,
  type Vec3,
  AXES,
  compose,
  cross,
  dot,
  inverse,
  length,
  normalized,
  rotate,
  turnAbout,
  unit,
} from "./space.ts";
import type { Placing } from "./slice-geometry.ts";

/** A plane through a marked point, as the server cuts it. */
export interface AcrossPlane {
  readonly mark: Vec3;
  /** By how much it is turned. */
  readonly turn_deg: number;
  /** From patient to view space: the plane's normal is towards the viewer. */
  readonly orientation: Quat;
  /** The direction outwards about which it is turned. */
  readonly turned_about: Vec3;
  /** The nearest standard plane, and by how many degrees it is turned: `cor > sag 32 > ax 10`. */
  readonly angles: string;
}

/** The server's text about a plane; null if it is none. */
export function readPlane(text: string | null): Pick<AcrossPlane, "orientation" | "turned_about" | "angles"> | null {
  const stated = parsed(text) as Partial<Record<keyof AcrossPlane, unknown>> | null;
  const orientation = numbers(stated?.orientation, 4) && unit(stated?.orientation as Quat);
  const about = numbers(stated?.turned_about, 3);
  const { angles } = stated ?? {};
  if (!orientation || !about || typeof angles !== "string") return null;
  return { orientation, turned_about: normalized(about as unknown as Vec3), angles };
}

const numbers = (given: unknown, count: number): readonly number[] | null =>
  Array.isArray(given) && given.length === count && given.every(Number.isFinite) ? given : null;

/** Planes that differ by half a turn are the same: -90 up to 90. */
export function boundTurn(turn_deg: number): number {
  const turned = (((turn_deg + 90) % 180) + 180) % 180;
  return Math.round((turned - 90) * 10) / 10;
}

/** A plane as it will be when it is turned otherwise; its picture is the server's. */
export function turnedPlane(plane: AcrossPlane, turn_deg: number): AcrossPlane {
  const angle_rad = ((turn_deg - plane.turn_deg) * Math.PI) / 180;
  const orientation = compose(plane.orientation, inverse(turnAbout(plane.turned_about, angle_rad)));
  return { ...plane, turn_deg, orientation };
}

export const normalOf = ({ orientation }: Pick<AcrossPlane, "orientation">): Vec3 =>
  rotate(inverse(orientation), [0, 0, 1]);

/** The sine of the least angle between two planes that have a line in common to draw, and to be turned by. */
const LEAST_SINE = 0.1;

/** The direction in which a plane crosses the slices across an axis; null if it lies in them. */
export function traceOf(plane: AcrossPlane, axis: 0 | 1 | 2): Vec3 | null {
  const along = cross(normalOf(plane), AXES[axis] ?? [0, 0, 1]);
  return length(along) < LEAST_SINE ? null : normalized(along);
}

/** By how much a plane is turned when it holds a direction; null if that is the one about which it is turned. */
export function turnTo(plane: AcrossPlane, direction: Vec3): number | null {
  const { turned_about: about, turn_deg } = plane;
  const wanted = cross(about, normalized(direction));
  if (length(wanted) < LEAST_SINE) return null;
  const normal = normalOf(plane);
  const angle_rad = Math.atan2(dot(cross(normal, wanted), about), dot(normal, wanted));
  return boundTurn(turn_deg + (angle_rad * 180) / Math.PI);
}

/** How far a position lies in front of the plane, in mm. */
export const awayFrom = (plane: AcrossPlane, position: Vec3): number => {
  const { mark } = plane;
  return dot(normalOf(plane), [position[0] - mark[0], position[1] - mark[1], position[2] - mark[2]]);
};

/** What the server's camera looks at: a plane has its mark in the middle. */
export const acrossSphere = ({ mark }: Pick<AcrossPlane, "mark">, { radius_mm }: Sphere): Sphere => ({
  center_in_patient: mark,
  radius_mm,
});

export const acrossView = ({ orientation }: Pick<AcrossPlane, "orientation">, placing: Placing): View => ({
  ...placing,
  orientation,
});

/** Whether a picture has the patient's left and right at its sides, rather than anterior and posterior. */
export function hasSides(plane: AcrossPlane): boolean {
  const right = rotate(inverse(plane.orientation), [1, 0, 0]);
  return Math.abs(right[0]) >= Math.abs(right[1]);
}
