// A small head whose sides cannot be mistaken: an ellipsoid, and on its right side a bright ball.

/** Voxels along each axis, and their edge in mm. */
const SIZE = [64, 76, 60] as const;
const EDGE_MM = 2;

/** A NIfTI-1 file of 16-bit voxels along R, A, S, whose values are asked for at places in RAS mm; moved by some mm. */
export function nifti(value: (x: number, y: number, z: number) => number, shift_mm = 0): Buffer {
  const [nx, ny, nz] = SIZE;
  const file = Buffer.alloc(352 + 2 * nx * ny * nz);
  file.writeInt32LE(348, 0);
  [3, nx, ny, nz, 1, 1, 1, 1].forEach((side, index) => file.writeInt16LE(side, 40 + 2 * index));
  file.writeInt16LE(4, 70);
  file.writeInt16LE(16, 72);
  [1, EDGE_MM, EDGE_MM, EDGE_MM].forEach((edge, index) => file.writeFloatLE(edge, 76 + 4 * index));
  file.writeFloatLE(352, 108);
  file.writeFloatLE(1, 112);
  file.writeUInt8(2, 123);
  file.writeInt16LE(1, 254);
  SIZE.forEach((side, axis) => {
    file.writeFloatLE(EDGE_MM, 280 + 16 * axis + 4 * axis);
    file.writeFloatLE((-EDGE_MM * (side - 1)) / 2 + shift_mm, 280 + 16 * axis + 12);
  });
  file.write("n+1\0", 344, "latin1");
  for (let z = 0, at = 352; z < nz; z += 1) {
    for (let y = 0; y < ny; y += 1) {
      for (let x = 0; x < nx; x += 1, at += 2) {
        const [right, front, up] = [x, y, z].map(
          (place, axis) => (place - ((SIZE[axis] ?? 1) - 1) / 2) * EDGE_MM + shift_mm,
        ) as [number, number, number];
        file.writeInt16LE(value(right, front, up), at);
      }
    }
  }
  return file;
}

/** Whether a place in RAS mm is of the brain: 100 by 124 by 92 mm. */
export const isBrain = (x: number, y: number, z: number): boolean => (x / 50) ** 2 + (y / 62) ** 2 + (z / 46) ** 2 < 1;
/** NIfTI counts to the patient's right: the ball of 12 mm lies 38 mm to that side. */
const isMark = (x: number, y: number, z: number): boolean => Math.hypot(x - 38, y, z) < 12;

/** Background 0, skull-less brain around 300 with a slow pattern, mark 1000. */
export const markedVolume = (seed = 0): Buffer =>
  nifti((x, y, z) =>
    !isBrain(x, y, z) ? 0 : isMark(x, y, z) ? 1000 : Math.round(300 + 20 * Math.sin((x + y + z + seed) / 9)),
  );
export const brainMask = (): Buffer => nifti((x, y, z) => (isBrain(x, y, z) ? 1 : 0));
