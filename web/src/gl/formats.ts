// Which sixteen-bit textures a device filters: found out by drawing and reading back, for what devices say is not
// always so.

import { createBlock, createProgram, createTarget, fillSlices, type Equipment, type Format, type Gl } from "./gl.ts";
import { STEPS_PER_VOXEL } from "../model/field.ts";
import type { Vec3 } from "../model/space.ts";
import type { Voxels } from "../model/wire.ts";

/** How a kind of voxels is kept. */
export interface Encoding {
  readonly format: Format;
  /** The stored value of a texel of 1. */
  readonly unit: number;
  /** Stored values as the texture takes them; those of whole numbers are handed over as they are. */
  encode(voxels: Voxels): ArrayBufferView<ArrayBuffer>;
}

/** How a device keeps intensities and depths. */
export interface Encodings {
  readonly bytes: Encoding;
  readonly intensities: Encoding;
  readonly depths: Encoding;
}

const R16_EXT = 0x822a;
const R16_SNORM_EXT = 0x8f98;
const RG16_EXT = 0x822c;
/** Intensities in half precision are divided by this, so that the greatest are numbers: `render::gpu::texels`. */
const HALF_SCALE = 32;

const asTheyAre = (voxels: Voxels): Voxels => voxels;

const halves = (gl: Gl, unit: number): Encoding => ({
  // The browser makes halves of them, to the nearest.
  format: { internal: gl.R16F, layout: gl.RED, type: gl.FLOAT },
  unit,
  encode: (voxels) => Float32Array.from(voxels, (stored) => stored / unit),
});

const wholes = (gl: Gl): Omit<Encodings, "bytes"> => ({
  intensities: {
    format: { internal: R16_EXT, layout: gl.RED, type: gl.UNSIGNED_SHORT },
    unit: 65535,
    encode: asTheyAre,
  },
  depths: { format: { internal: R16_SNORM_EXT, layout: gl.RED, type: gl.SHORT }, unit: 32767, encode: asTheyAre },
});

/** Each number, and whether it is defined, which 0 is not; `full` is a texel of 1 and `unit` the number of that. */
function pairs<Texels extends Uint8Array | Uint16Array | Float32Array>(
  texels: Texels,
  voxels: Voxels,
  full: number,
  unit: number,
): Texels {
  const factor = full / unit;
  for (let at = 0; at < voxels.length; at += 1) {
    const code = voxels[at] ?? 0;
    texels[2 * at] = code * factor;
    texels[2 * at + 1] = code === 0 ? 0 : full;
  }
  return texels;
}

/** A layer's voxels, whose 0 is undefined, in bytes or in 16 bits: as whole numbers if the device filters these. */
export function gapped(gl: Gl, isByte: boolean, { intensities }: Pick<Encodings, "intensities">): Encoding {
  if (isByte) {
    return {
      format: { internal: gl.RG8, layout: gl.RG, type: gl.UNSIGNED_BYTE },
      unit: 255,
      encode: (voxels) => pairs(new Uint8Array(2 * voxels.length), voxels, 255, 255),
    };
  }
  const isWhole = intensities.unit === 65535;
  return {
    format: isWhole
      ? { internal: RG16_EXT, layout: gl.RG, type: gl.UNSIGNED_SHORT }
      : { internal: gl.RG16F, layout: gl.RG, type: gl.FLOAT },
    unit: 65535,
    encode: (voxels) =>
      isWhole
        ? pairs(new Uint16Array(2 * voxels.length), voxels, 65535, 65535)
        : pairs(new Float32Array(2 * voxels.length), voxels, 1, 65535),
  };
}

/** The most exact encodings that the device filters; null where it filters none of sixteen bits. */
export function findEncodings(gl: Gl, probe: Equipment["probe"]): Encodings | null {
  const bytes = { format: { internal: gl.R8, layout: gl.RED, type: gl.UNSIGNED_BYTE }, unit: 255, encode: asTheyAre };
  const exact = gl.getExtension("EXT_texture_norm16") ? wholes(gl) : null;
  const half = { intensities: halves(gl, HALF_SCALE), depths: halves(gl, STEPS_PER_VOXEL) };
  const pick = (kind: "intensities" | "depths", voxels: Voxels): Encoding | null =>
    [exact, half]
      .map((offered) => offered?.[kind])
      .find((encoding) => encoding && isFiltered(gl, probe, encoding, voxels)) ?? null;
  const intensities = pick("intensities", new Uint16Array([1000, 3000]));
  const depths = pick("depths", new Int16Array([-1280, 3840]));
  return intensities && depths && { bytes, intensities, depths };
}

/** Whether two texels are mixed between their centres as they should be, to 1/64 of their difference. */
function isFiltered(gl: Gl, probe: Equipment["probe"], { format, unit, encode }: Encoding, pair: Voxels): boolean {
  while (gl.getError() !== gl.NO_ERROR && !gl.isContextLost());
  const size: Vec3 = [2, 1, 1];
  const texture = createBlock(gl, format, size);
  fillSlices(gl, texture, format, size, { first: 0, count: 1, texels: encode(pair) });
  const program = createProgram(gl, ...probe);
  const target = createTarget(gl, [1, 1]);
  const [low = 0, high = 0] = Array.from(pair, (stored) => stored / unit);
  gl.useProgram(program);
  gl.uniform2f(gl.getUniformLocation(program, "expected"), low + (high - low) / 4, (high - low) / 64);
  gl.uniform1i(gl.getUniformLocation(program, "texels"), 0);
  gl.activeTexture(gl.TEXTURE0);
  gl.bindTexture(gl.TEXTURE_3D, texture);
  gl.bindVertexArray(null);
  gl.viewport(0, 0, 1, 1);
  gl.disable(gl.DEPTH_TEST);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const pixel = new Uint8Array(4);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  const isClean = gl.getError() === gl.NO_ERROR;
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  target.dispose();
  gl.deleteTexture(texture);
  gl.deleteProgram(program);
  return isClean && pixel[0] === 255;
}
