// Paints what is drawn as SVG onto a canvas, as it is seen: for pictures that are saved.

import { decoded } from "../base/picture.ts";
import type { Vec2 } from "../model/space.ts";

/** What the style sheet says of drawings: a copy has it as attributes. */
const STYLED =
  "opacity fill stroke stroke-width stroke-dasharray font-family font-size font-weight text-anchor dominant-baseline";

/** Paints a drawing at a place of the canvas, in the canvas's own units. */
export async function paintSvg(
  context: CanvasRenderingContext2D,
  drawing: SVGSVGElement,
  [left, top]: Vec2,
): Promise<void> {
  const { width, height } = drawing.getBoundingClientRect();
  const copy = drawing.cloneNode(true) as SVGSVGElement;
  const copies = [copy, ...copy.querySelectorAll("*")];
  for (const [at, one] of [drawing, ...drawing.querySelectorAll("*")].entries()) {
    const style = getComputedStyle(one);
    for (const name of STYLED.split(" ")) copies[at]?.setAttribute(name, style.getPropertyValue(name));
  }
  copy.setAttribute("width", String(width));
  copy.setAttribute("height", String(height));
  const text = new XMLSerializer().serializeToString(copy);
  const picture = await decoded(new Blob([text], { type: "image/svg+xml" }));
  context.drawImage(picture, left, top, width, height);
}
