// A brain mask as the server sends it, and its outlines in slices: pure.

import type { Affine, Vec3 } from "./space.ts";
import { refuseUnless } from "./wire.ts";

/** Voxels along the patient's axes: not 0 in the brain. */
export interface MaskBlock {
  readonly size: Vec3;
  readonly voxels: Uint8Array;
  readonly patient_from_voxel: Affine;
}

const HEADER_BYTES = 348;
const UINT8 = 2;

/** Reads a NIfTI-1 file of eight bits along the patient's axes, as `GET …/mask` sends it. */
export function decodeMask(bytes: ArrayBuffer): MaskBlock {
  const header = new DataView(bytes);
  refuseUnless(bytes.byteLength >= HEADER_BYTES + 4 && header.getInt32(0, true) === HEADER_BYTES);
  const [nx, ny, nz] = [42, 44, 46].map((at) => header.getInt16(at, true)) as [number, number, number];
  const offset = header.getFloat32(108, true);
  refuseUnless(header.getInt16(70, true) === UINT8 && Math.min(nx, ny, nz) >= 1);
  refuseUnless(bytes.byteLength >= offset + nx * ny * nz);
  // NIfTI counts to the right and to the front, the patient's space here to the left and to the back.
  const row = (index: number, sign: number): number[] =>
    [0, 1, 2, 3].map((column) => sign * header.getFloat32(280 + 16 * index + 4 * column, true));
  const patient_from_voxel = [row(0, -1), row(1, -1), row(2, 1), [0, 0, 0, 1]];
  const isSkew = [0, 1, 2].some((axis) =>
    [0, 1, 2].some((other) => other !== axis && Math.abs(patient_from_voxel[axis]?.[other] ?? 1) > 1e-4),
  );
  refuseUnless(!isSkew);
  return { size: [nx, ny, nz], voxels: new Uint8Array(bytes, offset, nx * ny * nz), patient_from_voxel };
}

/** The axes of a slice across an axis: the voxel numbers along them are an outline's coordinates. */
export const axesAcross = (axis: 0 | 1 | 2): readonly [0 | 1 | 2, 0 | 1 | 2] =>
  axis === 0 ? [1, 2] : axis === 1 ? [0, 2] : [0, 1];

/**
 * The outline of the mask in the slice across `axis` whose voxels are nearest to a coordinate of the patient: the lines
 * of a path of SVG between voxels inside and outside, in voxel numbers. Empty beside the mask.
 */
export function maskOutline(
  { size, voxels, patient_from_voxel }: MaskBlock,
  axis: 0 | 1 | 2,
  position_mm: number,
): string {
  const [step = 1, offset = 0] = [patient_from_voxel[axis]?.[axis], patient_from_voxel[axis]?.[3]];
  const slice = Math.round((position_mm - offset) / step);
  if (slice < 0 || slice >= size[axis]) return "";
  const strides: Vec3 = [1, size[0], size[0] * size[1]];
  const [across, along] = axesAcross(axis);
  const start = slice * strides[axis];
  const isInside = (column: number, row: number): boolean =>
    column >= 0 &&
    row >= 0 &&
    column < size[across] &&
    row < size[along] &&
    voxels[start + column * strides[across] + row * strides[along]] !== 0;
  // Neighbouring edges on one line are one line.
  const lines = (
    outer: number,
    inner: number,
    isEdge: (line: number, place: number) => boolean,
    write: (line: number, from: number, to: number) => string,
  ): string => {
    let text = "";
    for (let line = 0; line <= outer; line += 1) {
      let from = -1;
      for (let place = 0; place <= inner; place += 1) {
        const edge = place < inner && isEdge(line, place);
        if (edge && from < 0) from = place;
        if (edge || from < 0) continue;
        text += write(line - 0.5, from - 0.5, place - 0.5);
        from = -1;
      }
    }
    return text;
  };
  return (
    lines(
      size[along],
      size[across],
      (row, column) => isInside(column, row - 1) !== isInside(column, row),
      (row, from, to) => `M${from} ${row}H${to}`,
    ) +
    lines(
      size[across],
      size[along],
      (column, row) => isInside(column - 1, row) !== isInside(column, row),
      (column, from, to) => `M${column} ${from}V${to}`,
    )
  );
}
