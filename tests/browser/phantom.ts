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

/** An element of DICOM in Explicit VR Little Endian. */
function element(tag: number, vr: string, value: string | Buffer): Buffer {
  const padded = typeof value === "string" ? Buffer.from(value) : value;
  const filler = Buffer.alloc(padded.length % 2, vr === "UI" ? 0 : 32);
  const length = padded.length + filler.length;
  const isLong = vr === "OB" || vr === "OW";
  const head = Buffer.alloc(isLong ? 12 : 8);
  head.writeUInt16LE(tag >>> 16, 0);
  head.writeUInt16LE(tag & 0xffff, 2);
  head.write(vr, 4, "latin1");
  if (isLong) head.writeUInt32LE(length, 8);
  else head.writeUInt16LE(length, 6);
  return Buffer.concat([head, padded, filler]);
}

const short = (value: number): Buffer => Buffer.from(Uint16Array.of(value).buffer);

/** The marked head as a series of DICOM files, one for each slice, with a patient. */
export function markedSeries(
  patient: { readonly name: string; readonly id: string },
  { description = "t1 phantom", study = "1.2.3" } = {},
): Buffer[] {
  const [columns, rows, slices] = SIZE;
  const at = (index: number, axis: 0 | 1 | 2): number => (index - (SIZE[axis] - 1) / 2) * EDGE_MM;
  return Array.from({ length: slices }, (_, slice) => {
    const pixels = Buffer.alloc(2 * rows * columns);
    // Columns go to the patient's left, rows backwards.
    for (let y = 0; y < rows; y += 1)
      for (let x = 0; x < columns; x += 1) {
        const [right, front, up] = [-at(x, 0), -at(y, 1), at(slice, 2)];
        const value = isMark(right, front, up) ? 1000 : 300 + 20 * Math.sin((right + front + up) / 9);
        pixels.writeUInt16LE(isBrain(right, front, up) ? Math.round(value) : 0, 2 * (y * columns + x));
      }
    const instance = `${study}.4.${slice + 1}`;
    const meta = [
      element(0x00020001, "OB", Buffer.from([0, 1])),
      element(0x00020002, "UI", "1.2.840.10008.5.1.4.1.1.4"),
      element(0x00020003, "UI", instance),
      element(0x00020010, "UI", "1.2.840.10008.1.2.1"),
    ];
    const length = Buffer.alloc(4);
    length.writeUInt32LE(Buffer.concat(meta).length);
    return Buffer.concat([
      Buffer.alloc(128),
      Buffer.from("DICM"),
      element(0x00020000, "UL", length),
      ...meta,
      element(0x00080005, "CS", "ISO_IR 192"),
      element(0x00080016, "UI", "1.2.840.10008.5.1.4.1.1.4"),
      element(0x00080018, "UI", instance),
      element(0x00080020, "DA", "20261101"),
      element(0x00080060, "CS", "MR"),
      element(0x0008103e, "LO", description),
      element(0x00100010, "PN", patient.name),
      element(0x00100020, "LO", patient.id),
      element(0x00100030, "DA", "19670312"),
      element(0x00100040, "CS", "F"),
      element(0x00180050, "DS", String(EDGE_MM)),
      element(0x0020000d, "UI", study),
      element(0x0020000e, "UI", `${study}.4`),
      element(0x00200011, "IS", "4"),
      element(0x00200013, "IS", String(slice + 1)),
      element(0x00200032, "DS", `${at(0, 0)}\\${at(0, 1)}\\${at(slice, 2)}`),
      element(0x00200037, "DS", "1\\0\\0\\0\\1\\0"),
      element(0x00200052, "UI", "1.2.3.9"),
      element(0x00280002, "US", short(1)),
      element(0x00280004, "CS", "MONOCHROME2"),
      element(0x00280010, "US", short(rows)),
      element(0x00280011, "US", short(columns)),
      element(0x00280030, "DS", `${EDGE_MM}\\${EDGE_MM}`),
      element(0x00280100, "US", short(16)),
      element(0x00280101, "US", short(16)),
      element(0x00280102, "US", short(15)),
      element(0x00280103, "US", short(0)),
      element(0x7fe00010, "OW", pixels),
    ]);
  });
}
