// WebGL 2, and the only place that makes programs, buffers and textures.

import type names from "../../shaders/names.json";
import type { Fields } from "./uniforms.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import type { ColorName } from "./colors.ts";

export type Gl = WebGL2RenderingContext;
type BlockName = keyof typeof names.blocks;
type ShaderName = keyof typeof names.shaders;
type VertexShaderName = ShaderName & `${string}.vert.glsl`;

/** Something of the graphics device could not be made; `message` holds the compiler's log where there is one. */
class GlError extends Error {}

/** The graphics device has no room. */
export class TooLarge extends GlError {}

/** What the painter draws with that is of no case. */
export interface Equipment {
  readonly shaders: Readonly<Record<ShaderName, string>>;
  readonly names: typeof names;
  /** A vertex and a fragment shader that find out whether a texture is filtered. */
  readonly probe: readonly [string, string];
  readonly colors: Readonly<Record<ColorName, string>>;
}

/** Something that must be there by now, or that the device must have made. */
export function made<T>(thing: T | null | undefined): T {
  if (thing == null) throw new GlError();
  return thing;
}

function compiled(gl: Gl, type: GLenum, text: string): WebGLShader {
  const shader = made(gl.createShader(type));
  gl.shaderSource(shader, text);
  gl.compileShader(shader);
  return shader;
}

/** What stands for a fragment shader where there are no colours. */
const NO_COLOR = `#version 300 es
void main() {}`;

/** What else a program has: an attribute, which is number 0, and what of its vertex shader can be kept. */
interface Ends {
  readonly attribute?: string | undefined;
  readonly captured?: readonly string[];
}

/** A program of two shaders. Throws the compiler's log, with the linker's. */
export function createProgram(
  gl: Gl,
  vertex: string,
  fragment: string,
  { attribute, captured }: Ends = {},
): WebGLProgram {
  const program = made(gl.createProgram());
  const shaders = [compiled(gl, gl.VERTEX_SHADER, vertex), compiled(gl, gl.FRAGMENT_SHADER, fragment)];
  for (const shader of shaders) gl.attachShader(program, shader);
  if (attribute) gl.bindAttribLocation(program, 0, attribute);
  if (captured) gl.transformFeedbackVaryings(program, captured, gl.SEPARATE_ATTRIBS);
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    const logs = [...shaders.map((shader) => gl.getShaderInfoLog(shader)), gl.getProgramInfoLog(program)];
    throw new GlError(logs.filter(Boolean).join("\n"));
  }
  for (const shader of shaders) gl.deleteShader(shader);
  return program;
}

/** Binding points of uniform blocks and units of textures, the same in all programs. */
const BLOCK_BINDINGS: Readonly<Record<string, number>> = { picture: 0, paths: 1, contours: 2 };
export const UNITS = {
  volume: 0,
  field: 1,
  normals: 2,
  smoothed: 3,
  colors: 4,
  rows: 5,
  pieces: 6,
  depths: 7,
  overlay: 8,
} as const;

/**
 * A program of a vertex and a fragment shader, their blocks and samplers bound to their places; without the latter it
 * has no colours.
 */
export function createTranslated(
  gl: Gl,
  { shaders, names }: Equipment,
  vertex: VertexShaderName,
  fragment?: ShaderName,
): WebGLProgram {
  const [attribute] = Object.values(names.shaders[vertex].attributes);
  const program = createProgram(gl, shaders[vertex], fragment ? shaders[fragment] : NO_COLOR, { attribute });
  bindPlaces(gl, program, [names.shaders[vertex], ...(fragment ? [names.shaders[fragment]] : [])]);
  return program;
}

/** A program that draws nothing: what its vertex shader hands on can be kept. */
export function createCapturing(gl: Gl, { shaders, names }: Equipment, vertex: VertexShaderName): WebGLProgram {
  const program = createProgram(gl, shaders[vertex], NO_COLOR, {
    captured: Object.values(names.shaders[vertex].outputs),
  });
  bindPlaces(gl, program, [names.shaders[vertex]]);
  return program;
}

type Named = (typeof names.shaders)[ShaderName];

function bindPlaces(gl: Gl, program: WebGLProgram, shaders: readonly Named[]): void {
  gl.useProgram(program);
  for (const { blocks, samplers } of shaders) {
    for (const [block, named] of Object.entries(blocks)) {
      const index = gl.getUniformBlockIndex(program, named);
      if (index !== gl.INVALID_INDEX) gl.uniformBlockBinding(program, index, BLOCK_BINDINGS[block] ?? 0);
    }
    for (const [sampler, named] of Object.entries(samplers)) {
      gl.uniform1i(gl.getUniformLocation(program, named), UNITS[sampler as keyof typeof UNITS]);
    }
  }
}

/** A uniform block on the device and its bytes here. */
export class UniformBlock {
  readonly #gl: Gl;
  readonly #offsets: Readonly<Record<string, number>>;
  readonly #buffer: WebGLBuffer;
  readonly #floats: Float32Array;
  readonly #wholes: Uint32Array;
  /** The fields that the shaders declare as whole numbers. */
  readonly #whole: ReadonlySet<string | undefined>;

  constructor(gl: Gl, { names, shaders }: Equipment, name: BlockName) {
    const { bytes, offsets } = names.blocks[name];
    this.#gl = gl;
    this.#offsets = offsets;
    this.#whole = new Set(
      [
        ...Object.values(shaders)
          .join("")
          .matchAll(/uint (\w+);/g),
      ].map(([, field]) => field),
    );
    const here = new ArrayBuffer(bytes);
    this.#floats = new Float32Array(here);
    this.#wholes = new Uint32Array(here);
    this.#buffer = made(gl.createBuffer());
    gl.bindBuffer(gl.UNIFORM_BUFFER, this.#buffer);
    gl.bufferData(gl.UNIFORM_BUFFER, bytes, gl.DYNAMIC_DRAW);
    gl.bindBufferBase(gl.UNIFORM_BUFFER, BLOCK_BINDINGS[name.toLowerCase()] ?? 0, this.#buffer);
  }

  write(fields: Fields): void {
    for (const [name, value] of Object.entries(fields)) {
      const offset = made(this.#offsets[name]);
      const target = this.#whole.has(name) ? this.#wholes : this.#floats;
      if (typeof value === "number") target[offset / 4] = value;
      else target.set(value, offset / 4);
    }
    this.#gl.bindBuffer(this.#gl.UNIFORM_BUFFER, this.#buffer);
    this.#gl.bufferSubData(this.#gl.UNIFORM_BUFFER, 0, this.#floats);
  }
}

/** Vertex numbers in the least room, as they are drawn. */
export function createIndices(gl: Gl, triangles: Uint32Array): WebGLBuffer {
  const buffer = made(gl.createBuffer());
  gl.bindVertexArray(null);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, triangles, gl.STATIC_DRAW);
  return buffer;
}

/** Triangles and, as attribute 0, the positions of their vertices. */
export interface Vertices {
  readonly array: WebGLVertexArrayObject;
  readonly positions: WebGLBuffer;
  readonly count: number;
}

/** Room for the positions of so many vertices. */
export function createVertices(gl: Gl, indices: WebGLBuffer, count: number): Vertices {
  const [array, positions] = [made(gl.createVertexArray()), made(gl.createBuffer())];
  gl.bindVertexArray(array);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, indices);
  gl.bindBuffer(gl.ARRAY_BUFFER, positions);
  gl.bufferData(gl.ARRAY_BUFFER, 12 * count, gl.DYNAMIC_DRAW);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
  gl.bindVertexArray(null);
  gl.bindBuffer(gl.ARRAY_BUFFER, null);
  return { array, positions, count };
}

export function writePositions(gl: Gl, { positions }: Vertices, values: Float32Array): void {
  gl.bindBuffer(gl.ARRAY_BUFFER, positions);
  gl.bufferSubData(gl.ARRAY_BUFFER, 0, values);
  gl.bindBuffer(gl.ARRAY_BUFFER, null);
}

/**
 * Runs a program's vertex shader, without attributes, once for each vertex and keeps its first output as the
 * positions.
 */
export function computePositions(gl: Gl, program: WebGLProgram, { positions, count }: Vertices): void {
  gl.useProgram(program);
  gl.bindVertexArray(null);
  gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, 0, positions);
  gl.enable(gl.RASTERIZER_DISCARD);
  gl.beginTransformFeedback(gl.POINTS);
  gl.drawArrays(gl.POINTS, 0, count);
  gl.endTransformFeedback();
  gl.disable(gl.RASTERIZER_DISCARD);
  gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, 0, null);
}

/** How texels of a texture are kept and handed over. */
export interface Format {
  readonly internal: GLenum;
  readonly layout: GLenum;
  readonly type: GLenum;
}

function createTexture(gl: Gl, target: GLenum, filter: GLenum): WebGLTexture {
  const texture = made(gl.createTexture());
  gl.bindTexture(target, texture);
  gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, filter);
  gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, filter);
  for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) {
    gl.texParameteri(target, side, gl.CLAMP_TO_EDGE);
  }
  return texture;
}

/** Texels that are read one by one, line by line from the first row on. */
export function createTable(gl: Gl, format: Format, size: Vec2, texels: ArrayBufferView<ArrayBuffer>): WebGLTexture {
  const texture = createTexture(gl, gl.TEXTURE_2D, gl.NEAREST);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.texStorage2D(gl.TEXTURE_2D, 1, format.internal, size[0], size[1]);
  gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, size[0], size[1], format.layout, format.type, texels);
  return texture;
}

/** A block of texels, filtered, with nothing in it yet. */
export function createBlock(gl: Gl, format: Format, size: Vec3): WebGLTexture {
  const texture = createTexture(gl, gl.TEXTURE_3D, gl.LINEAR);
  gl.texStorage3D(gl.TEXTURE_3D, 1, format.internal, size[0], size[1], size[2]);
  if (gl.getError() === gl.OUT_OF_MEMORY) throw new TooLarge(String(size));
  return texture;
}

export interface Slices {
  readonly first: number;
  readonly count: number;
  readonly texels: ArrayBufferView<ArrayBuffer>;
}

export function fillSlices(gl: Gl, texture: WebGLTexture, format: Format, size: Vec3, slices: Slices): void {
  gl.bindTexture(gl.TEXTURE_3D, texture);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  const { first, count, texels } = slices;
  gl.texSubImage3D(gl.TEXTURE_3D, 0, 0, 0, first, size[0], size[1], count, format.layout, format.type, texels);
}

/** A picture off screen. */
export interface Target {
  readonly frame: WebGLFramebuffer;
  readonly size: Vec2;
  dispose(): void;
}

export function createTarget(gl: Gl, size: Vec2): Target {
  const frame = made(gl.createFramebuffer());
  const buffer = made(gl.createRenderbuffer());
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
  gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, size[0], size[1]);
  gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, buffer);
  return {
    frame,
    size,
    dispose() {
      gl.deleteRenderbuffer(buffer);
      gl.deleteFramebuffer(frame);
    },
  };
}

/** Waits until the device has done its work so far, without holding up the page. */
export async function finished(gl: Gl): Promise<void> {
  const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  gl.flush();
  do await new Promise((resolve) => setTimeout(resolve, 1));
  while (fence && !gl.isContextLost() && gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED);
  gl.deleteSync(fence);
}

/** The pixels of a picture off screen, the top row first, once they are drawn; null if the context was lost. */
export async function readTarget(gl: Gl, { frame, size: [width, height] }: Target): Promise<ImageData | null> {
  const buffer = made(gl.createBuffer());
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
  gl.bufferData(gl.PIXEL_PACK_BUFFER, 4 * width * height, gl.STREAM_READ);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, 0);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  await finished(gl);
  if (gl.isContextLost()) return null;
  const picture = new ImageData(width, height);
  const rows = new Uint8ClampedArray(4 * width * height);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
  // All at once: browsers warn of each read.
  gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, rows);
  // The device's first row is at the bottom.
  for (let row = 0; row < height; row += 1)
    picture.data.set(rows.subarray(4 * width * row, 4 * width * (row + 1)), 4 * width * (height - 1 - row));
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
  gl.deleteBuffer(buffer);
  return picture;
}

/** A picture of depths, which shaders can read. */
export interface DepthTarget extends Target {
  readonly texture: WebGLTexture;
}

export function createDepthTarget(gl: Gl, size: Vec2): DepthTarget {
  const frame = made(gl.createFramebuffer());
  const texture = createTexture(gl, gl.TEXTURE_2D, gl.NEAREST);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, size[0], size[1]);
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, texture, 0);
  return {
    frame,
    texture,
    size,
    dispose() {
      gl.deleteTexture(texture);
      gl.deleteFramebuffer(frame);
    },
  };
}
