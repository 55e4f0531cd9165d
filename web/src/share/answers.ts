// What the server would answer, out of the file: each answer is gzipped, in base64.

import { summed } from "../model/wire.ts";
import type { SharedVolume } from "../store/surface.ts";

/** What the file says of itself. */
export interface About {
  /** Of the case. */
  readonly id: string;
  readonly language: string;
  /** Empty: the file names no patient. */
  readonly patient: string;
  readonly volume: SharedVolume;
  /** Whether it has the surfaces of the parts of the brain. */
  readonly has_parts: boolean;
}

interface AnswerAbout {
  /** Below the case. */
  readonly path: string;
  readonly headers: Readonly<Record<string, string>>;
  /** Whether its numbers of 16 bits are written as differences. */
  readonly are_differences: boolean;
}

const textsOf = (name: string): readonly string[] =>
  [...document.querySelectorAll(`script.${name}`)].map(({ textContent }) => textContent ?? "");

export const readAbout = (): About => JSON.parse(textsOf("about")[0] ?? "") as About;

/** Answers a request about the case; what is not in the file is not found. */
export async function answered(id: string, path: string): Promise<Response> {
  const case_path = `v1/cases/${id}`;
  const abouts = textsOf("answer-about").map((text) => JSON.parse(text) as AnswerAbout);
  const at = abouts.findIndex((one) => case_path + one.path === path);
  const [about, packed] = [abouts[at], textsOf("answer")[at]];
  if (!about || packed === undefined) {
    const headers = { "content-type": "application/problem+json" };
    return new Response('{"type":"urn:isocortex:problem:not-in-file"}', { status: 404, headers });
  }
  const unpacked = new Blob([bytesOf(packed)]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(unpacked).arrayBuffer();
  // The file never changes, and so its version is always the same.
  const headers = { ...about.headers, etag: '"file"' };
  return new Response(about.are_differences ? summed(new Uint8Array(bytes)) : bytes, { headers });
}

function bytesOf(base64: string): Uint8Array<ArrayBuffer> {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let at = 0; at < text.length; at += 1) bytes[at] = text.charCodeAt(at);
  return bytes;
}
