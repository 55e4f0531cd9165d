// Which sixteen-bit textures a device filters: found out by drawing and reading back, for what devices say is not
// always so.

import { createBlock, createProgram, createTarget, fillSlices, type Format, type Gl } from "./gl.ts";
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

/** A map's voxels, a byte each with 0 for undefined: that byte, and whether it is defined. */
export const gapped = (gl: Gl): Encoding => ({
  format: { internal: gl.RG8, layout: gl.RG, type: gl.UNSIGNED_BYTE },
  unit: 255,
  encode: (voxels) => {
    const texels = new Uint8Array(2 * voxels.length);
    voxels.forEach((code, at) => {
      texels[2 * at] = code;
      texels[2 * at + 1] = code === 0 ? 0 : 255;
    });
    return texels;
  },
});

/** The most exact encodings that the device filters; null where it filters none of sixteen bits. */
export function findEncodings(gl: Gl): Encodings | null {
  const bytes = { format: { internal: gl.R8, layout: gl.RED, type: gl.UNSIGNED_BYTE }, unit: 255, encode: asTheyAre };
  const exact = gl.getExtension("EXT_texture_norm16") ? wholes(gl) : null;
  const half = { intensities: halves(gl, HALF_SCALE), depths: halves(gl, STEPS_PER_VOXEL) };
  const pick = (kind: "intensities" | "depths", voxels: Voxels): Encoding | null =>
    [exact, half].map((offered) => offered?.[kind]).find((encoding) => encoding && isFiltered(gl, encoding, voxels)) ??
    null;
  const intensities = pick("intensities", new Uint16Array([1000, 3000]));
  const depths = pick("depths", new Int16Array([-1280, 3840]));
  return intensities && depths && { bytes, intensities, depths };
}

const PROBE_VERTEX = `#version 300 es
void main() { gl_Position = vec4(float(gl_VertexID & 1) * 4.0 - 1.0, float(gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;

/** White where the value a quarter of the way between two texels is what it should be. */
const PROBE_FRAGMENT = `#version 300 es
precision highp float;
uniform highp sampler3D texels;
uniform vec2 expected;
out vec4 color;
void main() {
  float found = textureLod(texels, vec3(0.375, 0.5, 0.5), 0.0).x;
  color = vec4(abs(found - expected.x) <= expected.y ? 1.0 : 0.0);
}`;

/** Whether two texels are mixed between their centres as they should be, to 1/64 of their difference. */
function isFiltered(gl: Gl, { format, unit, encode }: Encoding, pair: Voxels): boolean {
  while (gl.getError() !== gl.NO_ERROR && !gl.isContextLost());
  const size: Vec3 = [2, 1, 1];
  const texture = createBlock(gl, format, size);
  fillSlices(gl, texture, format, size, { first: 0, count: 1, texels: encode(pair) });
  const program = createProgram(gl, PROBE_VERTEX, PROBE_FRAGMENT);
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
