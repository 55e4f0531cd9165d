// Paints what is drawn as SVG onto a canvas, as it is seen: for pictures that are saved.

import type { Vec2 } from "../model/space.ts";

/** Paints an SVG element's shapes and texts at a place of the canvas, in the canvas's own units. */
export function paintSvg(context: CanvasRenderingContext2D, drawing: SVGSVGElement, [left, top]: Vec2): void {
  const { width, height } = drawing.getBoundingClientRect();
  context.save();
  context.beginPath();
  context.rect(left, top, width, height);
  context.clip();
  context.translate(left, top);
  for (const shape of drawing.querySelectorAll<SVGGraphicsElement>("line, circle, polygon, path, text"))
    if (shape.checkVisibility({ visibilityProperty: true })) paintShape(context, shape, drawing);
  context.restore();
}

function paintShape(context: CanvasRenderingContext2D, shape: SVGGraphicsElement, drawing: SVGSVGElement): void {
  const matrix = shape.getCTM();
  if (!matrix) return;
  const style = getComputedStyle(shape);
  context.save();
  context.globalAlpha = opacityOf(shape, drawing);
  context.transform(matrix.a, matrix.b, matrix.c, matrix.d, matrix.e, matrix.f);
  if (shape instanceof SVGTextElement) {
    context.fillStyle = style.fill;
    context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
    context.textAlign = style.textAnchor === "middle" ? "center" : style.textAnchor === "end" ? "end" : "start";
    context.textBaseline = style.dominantBaseline === "central" ? "middle" : "alphabetic";
    context.fillText(shape.textContent ?? "", number(shape, "x"), number(shape, "y"));
  } else {
    const outline = outlineOf(shape);
    if (style.fill !== "none") {
      context.fillStyle = style.fill;
      context.fill(outline);
    }
    if (style.stroke !== "none") {
      const keepsWidth = shape.getAttribute("vector-effect") === "non-scaling-stroke";
      const scale = keepsWidth ? Math.sqrt(Math.abs(matrix.a * matrix.d - matrix.b * matrix.c)) : 1;
      context.strokeStyle = style.stroke;
      context.lineWidth = parseFloat(style.strokeWidth) / (scale || 1);
      const dashes = style.strokeDasharray === "none" ? [] : style.strokeDasharray.split(/[ ,]+/).map(parseFloat);
      context.setLineDash(dashes);
      context.stroke(outline);
    }
  }
  context.restore();
}

const number = (shape: Element, name: string): number => Number(shape.getAttribute(name) ?? 0);

function outlineOf(shape: SVGGraphicsElement): Path2D {
  const at = (name: string): number => number(shape, name);
  switch (shape.localName) {
    case "line":
      return new Path2D(`M${at("x1")} ${at("y1")}L${at("x2")} ${at("y2")}`);
    case "polygon":
      return new Path2D(`M${shape.getAttribute("points")}Z`);
    case "circle": {
      const circle = new Path2D();
      circle.arc(at("cx"), at("cy"), at("r"), 0, 2 * Math.PI);
      return circle;
    }
    default:
      return new Path2D(shape.getAttribute("d") ?? "");
  }
}

function opacityOf(shape: Element, drawing: Element): number {
  let opacity = 1;
  for (let one: Element | null = shape; one && one !== drawing; one = one.parentElement) {
    opacity *= Number(getComputedStyle(one).opacity);
  }
  return opacity;
}
