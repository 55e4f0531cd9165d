// Sizes of pictures, tables and textures.

import type { Vec2, Vec3 } from "../model/space.ts";
import { voxelCount } from "../model/wire.ts";
import type { Gl, Target } from "./gl.ts";

/** Texels in a line of a table. */
const TABLE_WIDTH = 1024;

/** A size in other pixels; at least one. */
export const scaled = ([width, height]: Vec2, by: number): Vec2 => [
  Math.max(1, Math.round(width * by)),
  Math.max(1, Math.round(height * by)),
];

/** The target, if it has this size; one of another size is given back. */
export function fitting<T extends Target>(target: T | null, size: Vec2): T | null {
  if (target?.size.every((side, axis) => side === size[axis])) return target;
  target?.dispose();
  return null;
}

/** Numbers as texels of `parts` numbers each, in lines of a table; what is missing of the last line is 0. */
export function inLines<T extends Uint16Array<ArrayBuffer> | Uint32Array<ArrayBuffer>>(
  numbers: T,
  parts: number,
): { readonly texels: T; readonly size: Vec2 } {
  const perLine = TABLE_WIDTH * parts;
  const lines = Math.max(1, Math.ceil(numbers.length / perLine));
  const texels = new (numbers.constructor as new (length: number) => T)(lines * perLine);
  texels.set(numbers);
  return { texels, size: [TABLE_WIDTH, lines] };
}

/** Bytes on the device that a case's textures take, at most. */
export const textureBytes = (field_size: Vec3, volume_size: Vec3): number =>
  8 * voxelCount(field_size) + 3 * voxelCount(volume_size);

/** Whether blocks of these sizes fit a device's textures. */
export function fits(gl: Gl, sizes: readonly Vec3[]): boolean {
  const most = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE) as number;
  return sizes.every((size) => size.every((side) => side <= most));
}
