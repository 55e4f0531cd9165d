// Pictures and tables as files. Their names contain nothing about the patient.

import { ask } from "../base/api.ts";
import { t } from "../base/i18n.ts";

export function saveFile(bytes: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(bytes);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** The size of a picture in CSS pixels, how many of its own each of them has, and what stands below it. */
export interface Frame {
  readonly width: number;
  readonly height: number;
  readonly ratio: number;
  readonly caption: readonly string[];
}

const FONT_PIXELS = 12;
const LINE_PIXELS = 17;
const MARGIN_PIXELS = 8;

/** A picture with its caption, as PNG; `paint` draws it in CSS pixels. */
export async function captioned(
  { width, height, ratio, caption }: Frame,
  paint: (context: CanvasRenderingContext2D) => void,
): Promise<Blob> {
  const canvas = document.createElement("canvas");
  canvas.width = Math.round(width * ratio);
  const context = canvas.getContext("2d");
  if (!context) throw new Error(t("problem.unexpected"));
  const font = `${FONT_PIXELS}px ${getComputedStyle(document.body).fontFamily}`;
  context.font = font;
  const lines = caption.flatMap((line) => wrapped(line, width - 2 * MARGIN_PIXELS, context));
  const foot = lines.length * LINE_PIXELS + MARGIN_PIXELS;
  canvas.height = Math.round((height + foot) * ratio);
  context.scale(ratio, ratio);
  paint(context);
  context.fillStyle = "#000";
  context.fillRect(0, height, width, foot);
  context.fillStyle = "#f0f2f5";
  context.font = font;
  context.textBaseline = "middle";
  context.textAlign = "start";
  for (const [at, line] of lines.entries())
    context.fillText(line, MARGIN_PIXELS, height + MARGIN_PIXELS / 2 + (at + 0.5) * LINE_PIXELS);
  const png = await new Promise<Blob | null>((resolve) => canvas.toBlob(resolve, "image/png"));
  if (!png) throw new Error(t("problem.unexpected"));
  return png;
}

/** A text in lines of at most `width`, broken between its words. */
function wrapped(text: string, width: number, context: CanvasRenderingContext2D): string[] {
  const lines: string[] = [];
  for (const part of text.split(" ")) {
    const longer = lines.length > 0 ? `${lines.at(-1)} ${part}` : part;
    if (lines.length > 0 && context.measureText(longer).width <= width) lines[lines.length - 1] = longer;
    else lines.push(part);
  }
  return lines;
}

let version: Promise<string> | null = null;

/** The program's name and version; its name alone where the server does not tell. */
export function programWords(): Promise<string> {
  version ??= ask<{ version?: unknown }>("version", {}).then(
    ({ version: found }) => (typeof found === "string" ? `Isocortex ${found}` : "Isocortex"),
    () => {
      version = null;
      return "Isocortex";
    },
  );
  return version;
}
