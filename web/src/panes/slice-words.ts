// What a slice says of what it shows: the acquired image, and the layer whose edges it has.

import { t } from "../base/i18n.ts";
import { voxelAt } from "../base/readout.ts";
import type { ReadyCase } from "../model/case.ts";
import { type Vec3, PLANES, type Plane } from "../model/space.ts";
import { type ViewState, edgesLayer } from "../model/state.ts";
import { overlayWords, titleWords } from "./overlay.ts";

/** How nearly a slice must lie in the plane of acquisition: within 5°, as a cosine. */
const SAME_PLANE = 0.9962;

/**
 * Which DICOM image lies at a position, such as `image 36 of 192, series 3`; empty if that is unknown, or if slices of
 * the plane are not the acquired ones.
 */
export function imageWords(shown: ReadyCase, plane: Plane, position_in_patient: Vec3): string {
  const { images = [], series_number, patient_from_voxel, spacing_mm } = shown.volume;
  const slice = (voxelAt(shown, position_in_patient)?.[2] ?? -1) + 1;
  const run = images.find((one) => slice >= one.slice && slice < one.slice + one.count);
  const isAcquired = Math.abs(patient_from_voxel[PLANES[plane].axis]?.[2] ?? 0) >= SAME_PLANE * spacing_mm[2];
  if (!run || !isAcquired) return "";
  const count = images.reduce((sum, one) => sum + one.count, 0);
  const ends = images.flatMap((one) => [one.number, one.number + (one.count - 1) * one.step]);
  // Numbers that are not counted from 1 are not "of" a count.
  const key = ends.every((end) => end >= 1 && end <= count) ? "image.of" : "image.alone";
  const words = t(key, { number: run.number + (slice - run.slice) * run.step, count });
  return series_number === undefined ? words : `${words}, ${t("image.series", { number: series_number })}`;
}

/** Which layer a slice shows as edges, and if there is room, where its place comes from. */
export function edgesWords(state: ViewState, isLarge: boolean): string {
  const edges = edgesLayer(state);
  if (!edges) return "";
  const about = (state.layer ?? edges).about;
  return t("edges.of", { name: (isLarge ? titleWords(about) : about?.title) || overlayWords(edges) });
}

/** Whether the page is a frame beside that of another case: every picture names its own then. */
export const isBesideAnother = (): boolean => parent !== window;
