// The depth profile: intensity against depth below a point of the surface, with the mirrored point's curve.

import { h, setText, svg } from "../base/dom.ts";
import { gyrusWords, intensity, number, t } from "../base/i18n.ts";
import { greyWords } from "../base/readout.ts";
import { type Curve, type Measured, PROFILE_STEP_MM, type Profile } from "../model/profile.ts";
import { svgPicture } from "../panes/paint-svg.ts";
import { button, row } from "./fields.ts";
import { type LayerCurves, layerCurves, widthWords } from "./measured.ts";
import { captioned, saveFile } from "./picture-file.ts";
import { columnsOf, nearestSample, profileCsv } from "./profile-table.ts";

const WIDTH = 268;
const HEIGHT = 150;
const MARGIN = { left: 40, right: 8, top: 8, bottom: 30 } as const;

/** What is drawn: the cortex and the white matter below it; deeper down, a way in crosses other folds. */
const SHALLOW_MM = 30;
const DEEP_STEP_MM = 5;

/** Down to which depth a profile is drawn, with the depth that is shown in it. */
export const reachOfChart = (depth_mm: number): number =>
  Math.max(SHALLOW_MM, DEEP_STEP_MM * Math.ceil(depth_mm / DEEP_STEP_MM));

function shallowPart(profile: Profile, depth_mm: number): Profile {
  const count = reachOfChart(depth_mm) / PROFILE_STEP_MM + 1;
  return {
    depth_mm: profile.depth_mm.slice(0, count),
    intensity: profile.intensity.slice(0, count),
    mirrored: profile.mirrored.slice(0, count),
  };
}

/** The colours of outlines that differ from those of the two sides. */
const LAYER_COLOURS = ["outline-3", "outline-4", "outline-5", "outline-6"] as const;

/** About `count` round numbers from `low` to `high`. */
export function ticks(low: number, high: number, count: number): number[] {
  const raw = (high - low) / count;
  if (!(raw > 0) || !Number.isFinite(raw)) return [low];
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((size) => size >= raw * 0.999) ?? 10 * power;
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: Math.max(last - first + 1, 0) }, (_, index) => (first + index) * step);
}

/** The lines of a curve, interrupted where it has no value. */
export function pathOf(xs: readonly number[], ys: readonly number[]): string {
  let pen = "M";
  return xs
    .map((x, index) => {
      const y = ys[index] ?? NaN;
      if (!Number.isFinite(y)) {
        pen = "M";
        return "";
      }
      const command = `${pen}${x.toFixed(1)} ${y.toFixed(1)}`;
      pen = "L";
      return command;
    })
    .join("");
}

/** What can be done with a profile. */
interface ProfileUses {
  /** A place of the chart was clicked. */
  go(depth_mm: number): void;
  /** What stands below its picture. */
  caption(): Promise<readonly string[]>;
  /** How its files are called, without their endings. */
  readonly name: string;
  /** What the server measured; null until it has. */
  readonly measured: Measured | null;
}

/** The chart, what the pointer reads in it, its files and, for those who do not see it, its table. */
export function profileView(profile: Profile, depth_mm: number, uses: ProfileUses): HTMLElement {
  const shallow = shallowPart(profile, depth_mm);
  const deepest = shallow.depth_mm.at(-1) ?? 1;
  const values = [...shallow.intensity, ...shallow.mirrored].filter(Number.isFinite);
  const [low, high] = [Math.min(...values, 0), Math.max(...values, 1e-9)];
  const x = (depth: number): number => MARGIN.left + (depth / deepest) * (WIDTH - MARGIN.left - MARGIN.right);
  const y = (value: number): number =>
    HEIGHT - MARGIN.bottom - ((value - low) / (high - low)) * (HEIGHT - MARGIN.top - MARGIN.bottom);
  const curve = (name: string, ys: readonly number[]): SVGElement =>
    svg("path", { class: `curve ${name}`, d: pathOf(shallow.depth_mm.map(x), ys.map(y)) });
  const layers = uses.measured ? layerCurves(uses.measured, deepest) : [];
  // Each layer has its own scale, as high as the picture.
  const layerCurve = (side: string, points: Curve, [least, most]: LayerCurves["range"], at: number): SVGElement => {
    const height = (value: number): number => y(low + ((value - least) / (most - least || 1)) * (high - low));
    const lines = pathOf(
      points.map(([depth]) => x(depth)),
      points.map(([, value]) => height(value)),
    );
    return svg("path", { class: `curve layer ${side} ${LAYER_COLOURS[at % LAYER_COLOURS.length]}`, d: lines });
  };
  const upright = (name: string, at: number): SVGElement =>
    svg("line", { class: name, x1: at, x2: at, y1: MARGIN.top, y2: HEIGHT - MARGIN.bottom });
  const pointer = upright("pointer", 0);
  pointer.setAttribute("visibility", "hidden");
  const picture = svg(
    "svg",
    { class: "chart", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": t("profile.alt") },
    ...ticks(low, high, 4).flatMap((value) => [
      svg("line", { class: "grid", x1: MARGIN.left, x2: WIDTH - MARGIN.right, y1: y(value), y2: y(value) }),
      svg(
        "text",
        { class: "tick end", x: MARGIN.left - 5, y: y(value) + 3.5 },
        Number.isInteger(value) ? number(value) : intensity(value),
      ),
    ]),
    ...ticks(0, deepest, 5).map((depth) =>
      svg("text", { class: "tick middle", x: x(depth), y: HEIGHT - MARGIN.bottom + 13 }, number(depth)),
    ),
    svg(
      "text",
      { class: "tick middle", x: (MARGIN.left + WIDTH - MARGIN.right) / 2, y: HEIGHT - 3 },
      t("profile.axis"),
    ),
    depth_mm <= deepest ? upright("here", x(depth_mm)) : null,
    ...layers.flatMap(({ own, mirrored, range }, at) => [
      layerCurve("other", mirrored, range, at),
      layerCurve("own", own, range, at),
    ]),
    curve("other", shallow.mirrored),
    curve("own", shallow.intensity),
    pointer,
  );
  const depthAt = ({ clientX }: MouseEvent): number => {
    const box = picture.getBoundingClientRect();
    const place = ((clientX - box.left) / box.width) * WIDTH;
    const share = (place - MARGIN.left) / (WIDTH - MARGIN.left - MARGIN.right);
    return Math.min(Math.max(share, 0), 1) * deepest;
  };
  const columns = columnsOf(shallow, layers);
  const read = h("p", { class: "profile-read" }, t("profile.hint"));
  picture.addEventListener("pointermove", (event) => {
    const at = nearestSample(shallow, depthAt(event));
    const depth = shallow.depth_mm[at] ?? 0;
    pointer.setAttribute("transform", `translate(${x(depth)})`);
    pointer.setAttribute("visibility", "visible");
    // Two columns are the two sides of one curve.
    const parts = ["", ...layers.map(({ name }) => `${name} `)].map((name, index) => {
      const [own, mirrored] = [0, 1].map((side) => greyWords(columns[2 * index + side]?.[at]));
      return name + t("profile.both", { own: own ?? "", mirrored: mirrored ?? "" });
    });
    setText(read, `${number(depth, 2)} mm: ${parts.join(" · ")}`);
  });
  picture.addEventListener("pointerleave", () => {
    pointer.setAttribute("visibility", "hidden");
    setText(read, t("profile.hint"));
  });
  picture.addEventListener("click", (event) => uses.go(shallow.depth_mm[nearestSample(shallow, depthAt(event))] ?? 0));
  const legend = h(
    "p",
    { class: "legend" },
    h("span", { class: "own" }, t("profile.own")),
    h("span", { class: "other" }, t("profile.mirrored")),
    ...layers.map(({ words }, at) =>
      h("span", { class: "layer" }, h("i", { class: LAYER_COLOURS[at % LAYER_COLOURS.length] ?? "" }), words),
    ),
  );
  const width = uses.measured && widthWords(uses.measured);
  const gyrus = gyrusWords(uses.measured?.own.gyrus);
  const files = row(
    button(t("profile.png"), () => void savePicture(picture, layers, uses)),
    button(t("profile.csv"), () => void saveTable(profile, uses)),
  );
  const junction = width ? h("p", { class: "junction-width" }, `${t("point.width")}: ${width}`) : null;
  const place = gyrus ? h("p", { class: "gyrus" }, `${t("gyrus.about")}: ${gyrus}`) : null;
  return h(
    "div",
    { class: "profile" },
    place,
    junction,
    picture,
    legend,
    read,
    files,
    tableOf(shallow, columns, layers),
  );
}

/** The height of a line of the legend in a saved chart. */
const LEGEND_PIXELS = 20;

/** Saves the chart at four times its size on the screen. */
async function savePicture(
  chart: SVGSVGElement,
  layers: readonly LayerCurves[],
  { caption, name }: ProfileUses,
): Promise<void> {
  const { width, height } = chart.getBoundingClientRect();
  const page = getComputedStyle(document.body);
  // The own ones of the layers, then the two sides.
  const curves = chart.querySelectorAll(".curve:not(.layer.other)");
  const words = [...layers.map((layer) => layer.words), t("profile.mirrored"), t("profile.own")];
  const frame = { width, height: height + words.length * LEGEND_PIXELS, ratio: 4, caption: await caption() };
  const drawn = await svgPicture(chart);
  const png = await captioned(frame, (context) => {
    context.fillStyle = page.backgroundColor;
    context.fillRect(0, 0, width, frame.height);
    context.drawImage(drawn.image, 0, 0, width, height);
    context.font = `12px ${page.fontFamily}`;
    context.textBaseline = "middle";
    for (const [at, curve] of curves.entries()) {
      const middle = height + (at + 0.5) * LEGEND_PIXELS;
      const { stroke, strokeDasharray } = getComputedStyle(curve);
      context.strokeStyle = stroke;
      context.lineWidth = 2;
      context.setLineDash(strokeDasharray === "none" ? [] : [5, 3]);
      context.beginPath();
      context.moveTo(10, middle);
      context.lineTo(34, middle);
      context.stroke();
      context.fillStyle = page.color;
      context.fillText(words[at] ?? "", 40, middle);
    }
  });
  saveFile(png, `${name}-profile.png`);
}

async function saveTable(profile: Profile, { name, measured, caption }: ProfileUses): Promise<void> {
  const layers = measured ? layerCurves(measured, Infinity) : [];
  const csv = profileCsv(profile, layers, await caption());
  // A spreadsheet recognises UTF-8 by the mark.
  saveFile(new Blob(["\ufeff", csv], { type: "text/csv" }), `${name}-profile.csv`);
}

/** The profile at whole millimetres. */
function tableOf(
  { depth_mm }: Profile,
  columns: readonly (readonly number[])[],
  layers: readonly LayerCurves[],
): HTMLElement {
  const rows = depth_mm.flatMap((depth, index) => {
    if (depth % 1 !== 0) return [];
    const cells = columns.map((values) => h("td", {}, greyWords(values[index])));
    return [h("tr", {}, h("th", { scope: "row" }, number(depth, 1)), ...cells)];
  });
  const mirrored = t("profile.mirrored");
  const names = layers.flatMap(({ name }) => [name, `${name}, ${mirrored}`]);
  const titles = [t("profile.axis"), t("profile.own"), mirrored, ...names];
  const head = h("tr", {}, ...titles.map((words) => h("th", { scope: "col" }, words)));
  return h(
    "details",
    { class: "as-table" },
    h("summary", {}, t("profile.table")),
    h("table", {}, h("thead", {}, head), h("tbody", {}, ...rows)),
  );
}
