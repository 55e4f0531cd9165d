// Where the viewer stands: an orthographic camera around the envelope's sphere, as the server's `render::camera`.

import type { MirrorPlane, Sphere } from "./case.ts";
import { reflected } from "./midsagittal.ts";
import {
  type Quat,
  type Vec2,
  type Vec3,
  AXES,
  add,
  angleBetween,
  compose,
  cross,
  dot,
  fromRows,
  inverse,
  normalized,
  rotate,
  subtract,
} from "./space.ts";

/** The standard directions, in the order of the page's buttons. */
export const VIEW_NAMES = ["left", "right", "anterior", "posterior", "superior", "inferior"] as const;
export type ViewName = (typeof VIEW_NAMES)[number];

const looking = (up: Vec3, towards: Vec3): Quat => fromRows(cross(up, towards), up, towards);

/** From patient (LPS) to view space for each standard direction. */
export const NAMED_VIEWS: Readonly<Record<ViewName, Quat>> = {
  left: looking([0, 0, 1], [1, 0, 0]),
  right: looking([0, 0, 1], [-1, 0, 0]),
  anterior: looking([0, 0, 1], [0, -1, 0]),
  posterior: looking([0, 0, 1], [0, 1, 0]),
  superior: looking([0, -1, 0], [0, 0, 1]),
  inferior: looking([0, -1, 0], [0, 0, -1]),
};

/** The standard direction that an orientation is, within 0.1°. */
export function viewName(orientation: Quat): ViewName | null {
  return VIEW_NAMES.find((name) => angleBetween(NAMED_VIEWS[name], orientation) < 0.002) ?? null;
}

/** The orientation that brings the patient's direction `outward` to the viewer, the head's top (else its front) up. */
export function facing(outward: Vec3): Quat {
  const towards = normalized(outward);
  const upright: Vec3 = Math.abs(towards[2]) < 0.95 ? [0, 0, 1] : [0, -1, 0];
  const right = normalized(cross(upright, towards));
  return fromRows(right, cross(towards, right), towards);
}

/** What of a state the camera is made of. */
export interface View {
  readonly orientation: Quat;
  readonly zoom: number;
  readonly pan_mm: Vec2;
}

/**
 * The view whose picture, flipped left to right, shows the head mirrored at the plane as `view` shows the head.
 *
 * A flip and a mirror are each a half turn, but for the sign: about the view's x axis, and about the plane's normal.
 */
export function mirrored(view: View, plane: MirrorPlane, { center_in_patient }: Sphere): View {
  const [x, y, z, w] = compose(compose([1, 0, 0, 0], view.orientation), [...plane.normal, 0]);
  // The sphere's centre may be beside the plane.
  const [right, up] = rotate(view.orientation, subtract(reflected(center_in_patient, plane), center_in_patient));
  const [panX, panY] = view.pan_mm;
  return { orientation: [-x, -y, -z, -w], zoom: view.zoom, pan_mm: [-panX - right, panY + up] };
}

/** An orthographic projection onto a pane of `size` pixels; pixels count from the top left corner. */
export interface Projection {
  readonly mm_per_pixel: number;
  /** x and y in pixels, z in mm towards the viewer from the plane through the sphere's centre. */
  pixelOf(position_in_patient: Vec3): Vec3;
  /** The patient's position of such a place. */
  positionOf(place: Vec3): Vec3;
}

export function project(view: View, sphere: Sphere, size: Vec2): Projection {
  const mm_per_pixel = (2 * sphere.radius_mm) / (view.zoom * Math.min(...size));
  const { center_in_patient } = sphere;
  const [panX, panY] = view.pan_mm;
  const patient_from_view = inverse(view.orientation);
  // The view's axes in the patient: a turn of each of thousands of points would take longer than the picture.
  const [right, up, towards] = AXES.map((axis) => rotate(patient_from_view, axis)) as [Vec3, Vec3, Vec3];
  return {
    mm_per_pixel,
    pixelOf(position_in_patient) {
      const from_center = subtract(position_in_patient, center_in_patient);
      const [x, y] = [dot(right, from_center), dot(up, from_center)];
      return [
        size[0] / 2 + (x + panX) / mm_per_pixel,
        size[1] / 2 - (y + panY) / mm_per_pixel,
        dot(towards, from_center),
      ];
    },
    positionOf([x, y, z]) {
      const in_view: Vec3 = [(x - size[0] / 2) * mm_per_pixel - panX, (size[1] / 2 - y) * mm_per_pixel - panY, z];
      return add(center_in_patient, rotate(patient_from_view, in_view));
    },
  };
}

/** The patient's direction letters along +L, +P, +S and against them. */
export const LETTERS = [
  ["L", "R"],
  ["P", "A"],
  ["S", "I"],
] as const;

/** A second letter is given where its axis is at least 30° off the perpendicular; the strongest is first. */
function lettersOf(direction_in_patient: Vec3): string {
  return direction_in_patient
    .map((part, axis) => ({ size: Math.abs(part), letter: LETTERS[axis]?.[part > 0 ? 0 : 1] ?? "" }))
    .filter(({ size }) => size >= 0.5)
    .sort((a, b) => b.size - a.size)
    .slice(0, 2)
    .map(({ letter }) => letter)
    .join("");
}

/** The patient's directions at the edges of a picture. */
export interface Edges {
  readonly left: string;
  readonly right: string;
  readonly top: string;
  readonly bottom: string;
}

export function edgesOf(orientation: Quat): Edges {
  const patient_from_view = inverse(orientation);
  const letters = (direction: Vec3): string => lettersOf(rotate(patient_from_view, direction));
  return { left: letters([-1, 0, 0]), right: letters([1, 0, 0]), top: letters([0, 1, 0]), bottom: letters([0, -1, 0]) };
}

/** The direction towards the viewer, in the patient. */
export const towardsViewer = (orientation: Quat): Vec3 => rotate(inverse(orientation), [0, 0, 1]);

/** The direction from the sphere's centre to a position. */
export const outwardAt = (position_in_patient: Vec3, sphere: Sphere): Vec3 =>
  normalized(subtract(position_in_patient, sphere.center_in_patient));
