// The panes as one PNG: pictures, then what stands on them.

import { t } from "./i18n.ts";

/** Where an element lies within `frame`, in CSS pixels. */
function within(frame: Element, element: Element): { x: number; y: number; width: number; height: number } {
  const [outer, box] = [frame.getBoundingClientRect(), element.getBoundingClientRect()];
  return { x: box.left - outer.left, y: box.top - outer.top, width: box.width, height: box.height };
}

/** Paints the panes as they stand; `surface` is the picture in `surfaceHost`. */
export function paintPanes(panes: HTMLElement, surface: CanvasImageSource, surfaceHost: HTMLElement): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  const scale = devicePixelRatio;
  canvas.width = Math.round(panes.clientWidth * scale);
  canvas.height = Math.round(panes.clientHeight * scale);
  const context = canvas.getContext("2d");
  if (!context) return canvas;
  context.scale(scale, scale);
  context.fillStyle = "#000";
  context.fillRect(0, 0, canvas.width, canvas.height);
  const draw = (image: CanvasImageSource, element: Element, flipped: boolean): void => {
    const { x, y, width, height } = within(panes, element);
    context.save();
    context.translate(flipped ? x + width : x, y);
    context.scale(flipped ? -1 : 1, 1);
    context.drawImage(image, 0, 0, width, height);
    context.restore();
  };
  draw(surface, surfaceHost, false);
  for (const image of panes.querySelectorAll<HTMLImageElement>(".slice-image img")) {
    if (image.checkVisibility()) draw(image, image, image.closest(".flipped") !== null);
  }
  for (const ramp of panes.querySelectorAll<HTMLCanvasElement>("canvas.ramp")) draw(ramp, ramp, false);
  paintWriting(context, panes);
  return canvas;
}

function paintWriting(context: CanvasRenderingContext2D, panes: HTMLElement): void {
  context.textBaseline = "middle";
  context.shadowColor = "#000";
  context.shadowBlur = 3;
  for (const element of panes.querySelectorAll<HTMLElement>(".overlay span, .colour-bar span")) {
    if (!element.checkVisibility()) continue;
    const { x, y, width, height } = within(panes, element);
    const style = getComputedStyle(element);
    context.fillStyle = style.color;
    if (element.classList.contains("scale-line")) {
      context.fillStyle = style.backgroundColor;
      context.fillRect(x, y, width, height);
    } else {
      context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
      context.fillText(element.textContent ?? "", x + parseFloat(style.paddingLeft), y + height / 2);
    }
  }
  for (const line of panes.querySelectorAll<SVGLineElement>(".cursor line")) {
    if (!line.checkVisibility()) continue;
    const owner = line.ownerSVGElement;
    const frame = within(panes, owner ?? line);
    const { x: from_x, y: from_y } = owner?.viewBox.baseVal ?? { x: 0, y: 0 };
    const at = (name: "x1" | "y1" | "x2" | "y2"): number => line[name].baseVal.value;
    context.save();
    context.beginPath();
    context.rect(frame.x, frame.y, frame.width, frame.height);
    context.clip();
    context.strokeStyle = getComputedStyle(line).stroke;
    context.beginPath();
    context.moveTo(frame.x + at("x1") - from_x, frame.y + at("y1") - from_y);
    context.lineTo(frame.x + at("x2") - from_x, frame.y + at("y2") - from_y);
    context.stroke();
    context.restore();
  }
}

/** Saves the panes as a file whose name tells nothing of the patient. */
export async function saveScreenshot(panes: HTMLElement, surface: CanvasImageSource, surfaceHost: HTMLElement, name: string): Promise<void> {
  const canvas = paintPanes(panes, surface, surfaceHost);
  const blob = await new Promise<Blob | null>((resolve) => canvas.toBlob(resolve, "image/png"));
  if (!blob) throw new Error(t("problem.unexpected"));
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
