// The bytes that the service sends, as `server/service/src/wire/README.md` describes them. Every number is
// little-endian, as on every machine with WebGL. A body of another length than its header or question says is
// refused.

import type { Affine, Vec3 } from "./space.ts";

/** How fine a mesh is: the paper's N_F and N_P. */
export interface MeshSize {
  readonly contour_count: number;
  readonly points_per_contour: number;
}

export const vertexCount = (mesh: MeshSize): number => mesh.contour_count * mesh.points_per_contour + 2;
export const triangleCount = (mesh: MeshSize): number => 2 * mesh.contour_count * mesh.points_per_contour;

/** An answer that is not what the interface promises. */
export class WireError extends Error {}

/** Refuses a body that does not hold what it should. */
export function refuseUnless(holds: boolean): asserts holds {
  if (!holds) throw new WireError();
}

const checkLength = (bytes: ArrayBuffer, expected: number): void => refuseUnless(bytes.byteLength === expected);

/** Vertices of one depth: x, y, z in LPS mm for each. */
export function decodePositions(bytes: ArrayBuffer, mesh: MeshSize): Float32Array<ArrayBuffer> {
  checkLength(bytes, 12 * vertexCount(mesh));
  return new Float32Array(bytes);
}

/** Three vertex numbers for each triangle. */
export function decodeTriangles(bytes: ArrayBuffer, mesh: MeshSize): Uint32Array<ArrayBuffer> {
  checkLength(bytes, 12 * triangleCount(mesh));
  const triangles = new Uint32Array(bytes);
  const count = vertexCount(mesh);
  refuseUnless(triangles.every((vertex) => vertex < count));
  return triangles;
}

export interface PathsTable {
  readonly mesh: MeshSize;
  /** LPS mm of the stored position 0, 0, 0. */
  readonly origin_in_patient: Vec3;
  /** Millimetres in a stored step. */
  readonly step_mm: number;
  /** Depth from a row to the next. */
  readonly row_mm: number;
  readonly row_count: number;
  /**
   * Row by row and vertex by vertex: x, y, z and a 0 in stored steps, so that a texel of four 16-bit numbers holds
   * one.
   */
  readonly rows: Uint16Array<ArrayBuffer>;
  /** For each row the number of the first finer piece after it; at last the number of pieces. */
  readonly first_piece: Uint32Array<ArrayBuffer>;
  /** Six words for each piece: the vertex, two depths (as `f32`), two stored positions (six 16-bit numbers). */
  readonly pieces: Uint32Array<ArrayBuffer>;
}

const PATHS_HEADER_BYTES = 56;
const PIECE_BYTES = 24;
const MAGIC = 0x504f5349; // "ISOP"
const PATHS_LAYOUT = 2;

/** How many bytes a table has that begins so; null: that is not known yet. */
export function pathsLength(beginning: DataView): number | null {
  if (beginning.byteLength < PATHS_HEADER_BYTES) return null;
  const [vertices = 0, rows = 0, pieces = 0] = [16, 20, 24].map((offset) => beginning.getUint32(offset, true));
  return PATHS_HEADER_BYTES + 4 * (rows + 1) + PIECE_BYTES * pieces + 6 * rows * vertices + 4 * rows;
}

export function decodePaths(bytes: ArrayBuffer): PathsTable {
  const header = new DataView(bytes);
  checkLength(bytes, pathsLength(header) ?? NaN);
  const whole = (offset: number): number => header.getUint32(offset, true);
  const real = (offset: number): number => header.getFloat32(offset, true);
  refuseUnless(whole(0) === MAGIC);
  refuseUnless(header.getUint16(4, true) === PATHS_LAYOUT);
  const mesh = { contour_count: whole(8), points_per_contour: whole(12) };
  const [vertices, row_count, pieces] = [whole(16), whole(20), whole(24)];
  refuseUnless(vertices === vertexCount(mesh) && row_count > 0);
  const piecesAt = PATHS_HEADER_BYTES + 4 * (row_count + 1);
  const planesAt = piecesAt + PIECE_BYTES * pieces;
  const countsAt = planesAt + 6 * row_count * vertices;
  const first_piece = new Uint32Array(bytes.slice(PATHS_HEADER_BYTES, piecesAt));
  const inOrder = first_piece.every((first, row) => first <= (first_piece[row + 1] ?? pieces));
  refuseUnless(inOrder && first_piece[row_count] === pieces);
  const words = new Uint32Array(bytes.slice(piecesAt, planesAt));
  refuseUnless(areByVertex(words, first_piece));
  return {
    mesh,
    origin_in_patient: [real(28), real(32), real(36)],
    step_mm: real(40),
    row_mm: real(44),
    row_count,
    rows: summedRows(new Uint16Array(bytes.slice(planesAt, countsAt)), row_count, vertices),
    first_piece,
    pieces: words,
  };
}

/** Whether the pieces after each row are in the order of their vertices, among which the shader looks by halving. */
function areByVertex(pieces: Uint32Array, first_piece: Uint32Array): boolean {
  const words = PIECE_BYTES / 4;
  for (let row = 0; row + 1 < first_piece.length; row += 1) {
    const end = first_piece[row + 1] as number;
    for (let piece = (first_piece[row] as number) + 1; piece < end; piece += 1) {
      if ((pieces[piece * words] as number) < (pieces[(piece - 1) * words] as number)) return false;
    }
  }
  return true;
}

/** Positions from three planes of differences from the row before. */
function summedRows(planes: Uint16Array, row_count: number, vertices: number): Uint16Array<ArrayBuffer> {
  const perPlane = row_count * vertices;
  const rows = new Uint16Array(4 * perPlane);
  const perRow = 4 * vertices;
  for (let axis = 0; axis < 3; axis += 1) {
    const plane = planes.subarray(axis * perPlane, (axis + 1) * perPlane);
    for (let index = 0, out = axis; index < perPlane; index += 1, out += 4) {
      // What is written is taken modulo 2¹⁶; before the first row there is nothing.
      rows[out] = (plane[index] ?? 0) + (out >= perRow ? (rows[out - perRow] ?? 0) : 0);
    }
  }
  return rows;
}

/** Numbers of 16 bits from their differences, as `server/service/src/wire/texture.rs` writes them: all lower bytes, then all upper ones. */
export function summed(planes: Uint8Array): ArrayBuffer {
  const count = planes.length / 2;
  const numbers = new Uint16Array(count);
  for (let at = 0, sum = 0; at < count; at += 1) {
    const code = (planes[at] ?? 0) | ((planes[count + at] ?? 0) << 8);
    sum += (code >>> 1) ^ -(code & 1);
    // What is written is taken modulo 2¹⁶.
    numbers[at] = sum;
  }
  return numbers.buffer;
}

/** How to read a block of voxels. */
export interface TextureLayout {
  readonly size: Vec3;
  readonly format: "u8" | "u16" | "i16";
  /** Value = scale · stored + offset. */
  readonly scale: number;
  readonly offset: number;
  readonly patient_from_voxel: Affine;
}

const MAX_SIDE = 4096;

export function readLayout(headers: Headers): TextureLayout {
  const numbers = (name: string, count: number): number[] => {
    const list = (headers.get(`x-isocortex-${name}`) ?? "").split(",").map(Number);
    refuseUnless(list.length === count && list.every(Number.isFinite));
    return list;
  };
  const [x = 0, y = 0, z = 0] = numbers("size", 3);
  const isSide = (side: number): boolean => Number.isInteger(side) && side >= 1 && side <= MAX_SIDE;
  refuseUnless([x, y, z].every(isSide));
  const format = headers.get("x-isocortex-format");
  refuseUnless(format === "u8" || format === "u16" || format === "i16");
  const affine = numbers("patient-from-voxel", 12);
  return {
    size: [x, y, z],
    format,
    scale: numbers("scale", 1)[0] ?? 1,
    offset: numbers("offset", 1)[0] ?? 0,
    patient_from_voxel: [affine.slice(0, 4), affine.slice(4, 8), affine.slice(8, 12), [0, 0, 0, 1]],
  };
}

export const voxelCount = (size: Vec3): number => size[0] * size[1] * size[2];

export const byteLength = ({ size, format }: TextureLayout): number => voxelCount(size) * (format === "u8" ? 1 : 2);

export type Voxels = Uint8Array<ArrayBuffer> | Uint16Array<ArrayBuffer> | Int16Array<ArrayBuffer>;

/** A block of voxels, x-fastest. */
export interface Block<V extends Voxels = Voxels> extends TextureLayout {
  readonly voxels: V;
}

/** Intensities in 8 or 16 bits. */
export function decodeVolume(
  bytes: ArrayBuffer,
  layout: TextureLayout,
): Block<Uint8Array<ArrayBuffer> | Uint16Array<ArrayBuffer>> {
  checkLength(bytes, byteLength(layout));
  refuseUnless(layout.format !== "i16");
  return { ...layout, voxels: layout.format === "u8" ? new Uint8Array(bytes) : new Uint16Array(bytes) };
}

/** Depths in mm. */
export function decodeDistance(bytes: ArrayBuffer, layout: TextureLayout): Block<Int16Array<ArrayBuffer>> {
  checkLength(bytes, byteLength(layout));
  refuseUnless(layout.format === "i16");
  return { ...layout, voxels: new Int16Array(bytes) };
}

/**
 * The depths of a part, whose lowest bits are 1 where the depth is unknown: the bits are taken out of the depths, and are a block of
 * their own.
 */
export function* unfenced({
  voxels,
  ...layout
}: Block<Int16Array<ArrayBuffer>>): Generator<
  void,
  { readonly field: Block<Int16Array<ArrayBuffer>>; readonly fenced: Uint8Array<ArrayBuffer> }
> {
  const fenced = new Uint8Array(voxels.length);
  const depths = new Int16Array(voxels.length);
  const slice = layout.size[0] * layout.size[1];
  for (let start = 0; start < voxels.length; start += slice) {
    for (let at = start; at < start + slice; at += 1) {
      const value = voxels[at] as number;
      fenced[at] = value & 1;
      depths[at] = value & ~1;
    }
    yield;
  }
  return { field: { ...layout, voxels: depths }, fenced };
}
