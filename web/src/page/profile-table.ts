// The profile of a point in numbers: what the pointer reads, a table and a file.

import { clamp } from "../model/space.ts";
import { type Curve, PROFILE_STEP_MM, type Profile, type SidedCurves } from "../model/profile.ts";

/** A curve has no value between samples that are further apart: the server's are half as far. */
const LONGEST_STEP_MM = 1;

/** The value of a curve at a depth, between its samples; NaN beyond them. */
export function valueAt(curve: Curve, depth_mm: number): number {
  const at = curve.findIndex(([depth]) => depth >= depth_mm);
  const [far, value] = curve[at] ?? [NaN, NaN];
  const [near, before] = curve[at - 1] ?? [depth_mm, value];
  if (far - near > LONGEST_STEP_MM) return NaN;
  return far > near ? before + ((depth_mm - near) / (far - near)) * (value - before) : value;
}

/** The columns of a profile's table: intensities, then each layer on both sides, at the depths of the intensities. */
export function columnsOf(profile: Profile, layers: readonly SidedCurves[]): readonly (readonly number[])[] {
  const sides = layers.flatMap(({ own, mirrored }) => [own, mirrored]);
  const curves = sides.map((curve) => profile.depth_mm.map((depth) => valueAt(curve, depth)));
  return [profile.intensity, profile.mirrored, ...curves];
}

/**
 * The profile as comma-separated values; what is not known is empty. Each row ends with the lines below a picture of
 * the case: a table of several profiles still says which row is whose.
 */
export function profileCsv(profile: Profile, layers: readonly SidedCurves[], caption: readonly string[]): string {
  const quoted = (text: string): string => `,"${text.replaceAll('"', '""')}"`;
  const cell = (value = NaN): string => (Number.isFinite(value) ? String(Number(value.toPrecision(7))) : "");
  const columns = [profile.depth_mm, ...columnsOf(profile, layers)];
  const end = caption.map(quoted).join("");
  const rows = profile.depth_mm.map((_, at) => columns.map((values) => cell(values[at])).join(",") + end);
  const names = layers.flatMap(({ name }) => [name, `mirrored ${name}`].map(quoted));
  return [`depth_mm,intensity,mirrored_intensity${names.join("")},case,view,program`, ...rows, ""].join("\r\n");
}

export const nearestSample = (profile: Profile, depth_mm: number): number =>
  clamp(Math.round(depth_mm / PROFILE_STEP_MM), 0, profile.depth_mm.length - 1);
