// Numbers of a place, in words.

import { LETTERS } from "../model/camera.ts";
import type { ReadyCase } from "../model/case.ts";
import { type Place, SLICE_SLOTS, type ViewState, shallowMean, slabOf } from "../model/state.ts";
import { intensity, number, t } from "./i18n.ts";
import { PLANE_NAMES, type Vec3, inverted, transform } from "../model/space.ts";

/** `L 32.1 · A 12.0 · S 45.2`, in mm; a line is never broken between a letter and its number. */
export function positionWords(position_in_patient: Vec3): string {
  return position_in_patient.map((value, axis) => coordinate(value, axis)).join(" · ");
}

/** One coordinate with its side, such as `S 45.2`. */
export const coordinate = (value: number, axis: number): string =>
  `${LETTERS[axis]?.[value < 0 ? 1 : 0] ?? ""}\u00a0${number(Math.abs(value), 1)}`;

/** The depth of a state, and over how much of it intensities are averaged, where they are. */
export function depthWords(state: Pick<ViewState, "depth_mm" | "slab_mm" | "averages_shallow">): string {
  // As exact as the box in which it is typed.
  const isTenths = Math.abs(10 * state.depth_mm - Math.round(10 * state.depth_mm)) < 0.05;
  const depth = `${number(state.depth_mm, isTenths ? 1 : 2)} mm`;
  if (state.slab_mm > 0) return t("depth.slab", { depth, slab: number(state.slab_mm, 1) });
  const mean_mm = slabOf(state) > 0 ? shallowMean(state.depth_mm) : 0;
  return mean_mm > 0 ? t("depth.mean", { depth, mean: number(mean_mm, 1) }) : depth;
}

/** The voxel of the volume as it was acquired, counted from 0; null beside the volume. */
export function voxelAt(shown: ReadyCase, position_in_patient: Vec3): Vec3 | null {
  const voxel_from_patient = inverted(shown.volume.patient_from_voxel);
  if (!voxel_from_patient) return null;
  const voxel = transform(voxel_from_patient, position_in_patient).map(Math.round) as unknown as Vec3;
  const inside = voxel.every((value, axis) => value >= 0 && value < (shown.volume.size[axis] ?? 0));
  // No minus before a zero.
  return inside ? [voxel[0] + 0, voxel[1] + 0, voxel[2] + 0] : null;
}

/** Lengths that a scale bar may have, in mm. */
const BARS_MM = [1, 2, 5, 10, 20, 50, 100, 200] as const;

/** The longest round length that is at most `longest` pixels. */
export function scaleBar(mm_per_pixel: number, longest: number): { readonly mm: number; readonly pixels: number } {
  const mm = BARS_MM.findLast((bar) => bar / mm_per_pixel <= longest) ?? BARS_MM[0];
  return { mm, pixels: mm / mm_per_pixel };
}

/** Which pane is meant: of a slice, its plane. */
export function paneWords({ plane, panes, beside }: ViewState, place: Place): string {
  const at = (SLICE_SLOTS as readonly Place[]).indexOf(place);
  if (at >= 0) return plane ? `${t(`plane.${plane}`)} ${number(at + 1)}` : t(`plane.${PLANE_NAMES[at] ?? "axial"}`);
  if (place === "all" && beside) return t("pane.right");
  if (place === "all" && Object.keys(panes).length > 0) return t("pane.others");
  return t(`pane.${place as Exclude<Place, (typeof SLICE_SLOTS)[number]>}`);
}

/** An intensity; a dash where it is unknown. */
export const greyWords = (value?: number | null): string => (Number.isFinite(value) ? intensity(Number(value)) : "–");

/** A value and the volume that it is of. */
export interface NamedValue {
  readonly name: string;
  readonly value: number;
}

/** The intensity of the case, then the values of what else is shown: `T1 195 · FLAIR 31`. */
export const valueWords = (grey: number | null | undefined, others: readonly NamedValue[]): string =>
  [
    `${t("value.own")}\u00a0${greyWords(grey)}`,
    ...others.map(({ name, value }) => `${name}\u00a0${greyWords(value)}`),
  ].join(" · ");

/** The depth of a position; outside of the envelope it has none. A dash where it is unknown, as beside a cut. */
export function depthAtWords(depth_mm = NaN): string {
  if (depth_mm <= -0.05) return t("point.outside");
  return Number.isFinite(depth_mm) ? `${number(depth_mm, 1)} mm` : "–";
}
