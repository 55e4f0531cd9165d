// The panes as one PNG: pictures, then what stands on them.

import { t } from "../base/i18n.ts";

/** Where an element lies within `frame`, in CSS pixels. */
function within(frame: Element, element: Element): { x: number; y: number; width: number; height: number } {
  const [outer, box] = [frame.getBoundingClientRect(), element.getBoundingClientRect()];
  return { x: box.left - outer.left, y: box.top - outer.top, width: box.width, height: box.height };
}

/** Paints the panes as they stand; `surface` is the picture in `surfaceHost`. */
export function paintPanes(
  panes: HTMLElement,
  surface: CanvasImageSource,
  surfaceHost: HTMLElement,
): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  const scale = devicePixelRatio;
  canvas.width = Math.round(panes.clientWidth * scale);
  canvas.height = Math.round(panes.clientHeight * scale);
  const context = canvas.getContext("2d");
  if (!context) return canvas;
  context.scale(scale, scale);
  context.fillStyle = "#000";
  context.fillRect(0, 0, canvas.width, canvas.height);
  const isShown = shownIn(panes);
  const draw = (image: CanvasImageSource, element: Element, flipped: boolean): void => {
    const { x, y, width, height } = within(panes, element);
    context.save();
    const clip = within(panes, element.closest(".pane") ?? element);
    context.beginPath();
    context.rect(clip.x, clip.y, clip.width, clip.height);
    context.clip();
    context.translate(flipped ? x + width : x, y);
    context.scale(flipped ? -1 : 1, 1);
    context.drawImage(image, 0, 0, width, height);
    context.restore();
  };
  if (isShown(surfaceHost)) draw(surface, surfaceHost, false);
  for (const image of panes.querySelectorAll<HTMLImageElement>(".slice-image img")) {
    if (isShown(image)) draw(image, image, image.closest(".flipped") !== null);
  }
  for (const ramp of panes.querySelectorAll<HTMLCanvasElement>("canvas.ramp"))
    if (isShown(ramp)) draw(ramp, ramp, false);
  paintWriting(context, panes);
  paintCube(context, panes);
  return canvas;
}

/** Whether an element is to be seen: not under a slice that is as large as all panes. */
function shownIn(panes: HTMLElement): (element: Element) => boolean {
  const large = panes.querySelector(".pane.large");
  return (element) => element.checkVisibility() && (!large?.checkVisibility() || large.contains(element));
}

function paintWriting(context: CanvasRenderingContext2D, panes: HTMLElement): void {
  const isShown = shownIn(panes);
  context.textBaseline = "middle";
  context.shadowColor = "#000";
  context.shadowBlur = 3;
  for (const element of panes.querySelectorAll<HTMLElement>(".overlay span, .colour-bar span")) {
    if (!isShown(element)) continue;
    const { x, y, width, height } = within(panes, element);
    const style = getComputedStyle(element);
    context.fillStyle = style.color;
    if (element.classList.contains("scale-line")) {
      context.fillStyle = style.backgroundColor;
      context.fillRect(x, y, width, height);
    } else {
      context.shadowColor = "transparent";
      context.fillStyle = style.backgroundColor;
      context.fillRect(x, y, width, height);
      context.shadowColor = "#000";
      context.fillStyle = style.color;
      context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
      context.fillText(element.textContent ?? "", x + parseFloat(style.paddingLeft), y + height / 2);
    }
  }
  for (const line of panes.querySelectorAll<SVGLineElement>(".cursor line")) {
    if (!isShown(line)) continue;
    const owner = line.ownerSVGElement;
    const frame = within(panes, owner ?? line);
    const { x: fromX, y: fromY } = owner?.viewBox.baseVal ?? { x: 0, y: 0 };
    const at = (name: "x1" | "y1" | "x2" | "y2"): number => line[name].baseVal.value;
    context.save();
    context.beginPath();
    context.rect(frame.x, frame.y, frame.width, frame.height);
    context.clip();
    stroked(context, line);
    context.beginPath();
    context.moveTo(frame.x + at("x1") - fromX, frame.y + at("y1") - fromY);
    context.lineTo(frame.x + at("x2") - fromX, frame.y + at("y2") - fromY);
    context.stroke();
    context.restore();
  }
  for (const circle of panes.querySelectorAll<SVGCircleElement>(".cursor circle")) {
    if (!isShown(circle)) continue;
    const { x, y, width, height } = within(panes, circle);
    context.save();
    stroked(context, circle);
    context.beginPath();
    context.arc(x + width / 2, y + height / 2, circle.r.baseVal.value, 0, 2 * Math.PI);
    context.stroke();
    context.restore();
  }
}

/** Takes over how a shape is stroked. */
function stroked(context: CanvasRenderingContext2D, shape: SVGElement): void {
  const style = getComputedStyle(shape);
  context.strokeStyle = style.stroke;
  context.lineWidth = parseFloat(style.strokeWidth);
  context.setLineDash(style.strokeDasharray === "none" ? [] : style.strokeDasharray.split(/[ ,]+/).map(parseFloat));
}

/** The orientation cube, as it stands. */
function paintCube(context: CanvasRenderingContext2D, panes: HTMLElement): void {
  const cube = panes.querySelector<SVGSVGElement>("svg.cube");
  if (!cube || !shownIn(panes)(cube)) return;
  const { x, y, width } = within(panes, cube);
  const { x: fromX, y: fromY, width: side } = cube.viewBox.baseVal;
  context.save();
  context.translate(x, y);
  context.scale(width / side, width / side);
  context.translate(-fromX, -fromY);
  for (const face of cube.querySelectorAll<SVGGElement>("g")) {
    const [polygon, letter] = [face.querySelector("polygon"), face.querySelector("text")];
    if (!polygon || !letter) continue;
    context.globalAlpha = Number(face.getAttribute("opacity"));
    const outline = new Path2D(`M${polygon.getAttribute("points")}Z`);
    context.fillStyle = getComputedStyle(polygon).fill;
    context.fill(outline);
    stroked(context, polygon);
    context.stroke(outline);
    const style = getComputedStyle(letter);
    context.fillStyle = style.fill;
    context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillText(letter.textContent ?? "", Number(letter.getAttribute("x")), Number(letter.getAttribute("y")));
  }
  context.restore();
}

/** Saves the panes as a file whose name tells nothing of the patient. */
export async function saveScreenshot(
  panes: HTMLElement,
  surface: CanvasImageSource,
  surfaceHost: HTMLElement,
  name: string,
): Promise<void> {
  const canvas = paintPanes(panes, surface, surfaceHost);
  const blob = await new Promise<Blob | null>((resolve) => canvas.toBlob(resolve, "image/png"));
  if (!blob) throw new Error(t("problem.unexpected"));
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
