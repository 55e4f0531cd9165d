// The depth profile: intensity against depth below a point of the surface, with the mirrored point's curve.

import { clamp } from "../model/space.ts";
import { signal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useRef, useState } from "preact/hooks";

import { gyrusWords, intensity, number, t } from "../base/i18n.ts";
import { greyWords } from "../base/readout.ts";
import { type Curve, PROFILE_STEP_MM, type Profile } from "../model/profile.ts";
import { svgPicture } from "../panes/paint-svg.ts";
import { type LayerCurves, layerCurves, widthWords } from "../store/measured.ts";
import type { Store } from "../store/store.ts";
import { captionOf, fileStem } from "./export.ts";
import { Button, type OfStore, Row } from "./fields.tsx";
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

/** Whether the table is open, whatever depth is gone to and wherever the chart stands. */
const isTableOpen = signal(false);

const MIDDLE = (MARGIN.left + WIDTH - MARGIN.right) / 2;
const INNER_WIDTH = WIDTH - MARGIN.left - MARGIN.right;
const BOTTOM = HEIGHT - MARGIN.bottom;

/** The chart of the marked point, what the pointer reads in it, its files and, for those who do not see it, its table. */
export function Chart({ store }: OfStore) {
  const profile = store.point.profile.value;
  const measured = store.point.measured.value;
  const depth_mm = store.view.depth_mm.value;
  const picture = useRef<SVGSVGElement>(null);
  const [read, setRead] = useState<number | null>(null);
  if (!profile) return null;
  const shallow = shallowPart(profile, depth_mm);
  const deepest = shallow.depth_mm.at(-1) ?? 1;
  const values = [...shallow.intensity, ...shallow.mirrored].filter(Number.isFinite);
  const [low, high] = [Math.min(...values, 0), Math.max(...values, 1e-9)];
  const x = (depth: number): number => MARGIN.left + (depth / deepest) * INNER_WIDTH;
  const y = (value: number): number => BOTTOM - ((value - low) / (high - low)) * (BOTTOM - MARGIN.top);
  const curve = (ys: readonly number[]): string => pathOf(shallow.depth_mm.map(x), ys.map(y));
  const layers = measured ? layerCurves(measured, deepest) : [];
  // Each layer has its own scale, as high as the picture.
  const layerCurve = (points: Curve, [least, most]: LayerCurves["range"]): string =>
    pathOf(
      points.map(([depth]) => x(depth)),
      points.map(([, value]) => y(low + ((value - least) / (most - least || 1)) * (high - low))),
    );
  const sampleAt = ({ clientX }: MouseEvent): number => {
    const box = picture.current?.getBoundingClientRect() ?? { left: 0, width: 1 };
    const share = (((clientX - box.left) / box.width) * WIDTH - MARGIN.left) / INNER_WIDTH;
    return nearestSample(shallow, clamp(share, 0, 1) * deepest);
  };
  const depthOf = (sample: number): number => shallow.depth_mm[sample] ?? 0;
  const columns = columnsOf(shallow, layers);
  const readWords = (sample: number): string => {
    // Two columns are the two sides of one curve.
    const parts = ["", ...layers.map(({ name }) => `${name} `)].map((name, index) => {
      const [own, mirrored] = [0, 1].map((side) => greyWords(columns[2 * index + side]?.[sample]));
      return name + t("profile.both", { own, mirrored });
    });
    return `${number(depthOf(sample), 2)} mm: ${parts.join(" · ")}`;
  };
  const width = measured && widthWords(measured);
  const gyrus = gyrusWords(measured?.own.gyrus);
  return (
    <div class="profile">
      {gyrus && <p class="gyrus">{`${t("gyrus.about")}: ${gyrus}`}</p>}
      {width && <p class="junction-width">{`${t("point.width")}: ${width}`}</p>}
      <svg
        ref={picture}
        class="chart"
        viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
        role="img"
        aria-label={t("profile.alt")}
        onPointerMove={(event) => setRead(sampleAt(event))}
        onPointerLeave={() => setRead(null)}
        onClick={(event) => store.view.goToDepth(depthOf(sampleAt(event)))}
      >
        {ticks(low, high, 4).map((value) => (
          <>
            <line class="grid" x1={MARGIN.left} x2={WIDTH - MARGIN.right} y1={y(value)} y2={y(value)} />
            <text class="tick end" x={MARGIN.left - 5} y={y(value) + 3.5}>
              {Number.isInteger(value) ? number(value) : intensity(value)}
            </text>
          </>
        ))}
        {ticks(0, deepest, 5).map((depth) => (
          <text class="tick middle" x={x(depth)} y={BOTTOM + 13}>
            {number(depth)}
          </text>
        ))}
        <text class="tick middle" x={MIDDLE} y={HEIGHT - 3}>
          {t("profile.axis")}
        </text>
        {depth_mm <= deepest && <line class="here" x1={x(depth_mm)} x2={x(depth_mm)} y1={MARGIN.top} y2={BOTTOM} />}
        {layers.map(({ own, mirrored, range }, at) => (
          <>
            <path class={`curve layer other ${colourOf(at)}`} d={layerCurve(mirrored, range)} />
            <path class={`curve layer own ${colourOf(at)}`} d={layerCurve(own, range)} />
          </>
        ))}
        <path class="curve other" d={curve(shallow.mirrored)} />
        <path class="curve own" d={curve(shallow.intensity)} />
        <line
          class="pointer"
          x1={0}
          x2={0}
          y1={MARGIN.top}
          y2={BOTTOM}
          visibility={read === null ? "hidden" : "visible"}
          transform={`translate(${x(depthOf(read ?? 0))})`}
        />
      </svg>
      <p class="legend">
        <span class="own">{t("profile.own")}</span>
        <span class="other">{t("profile.mirrored")}</span>
        {layers.map(({ words }, at) => (
          <span class="layer" key={words}>
            <i class={colourOf(at)} />
            {words}
          </span>
        ))}
      </p>
      <p class="profile-read">{read === null ? t("profile.hint") : readWords(read)}</p>
      <Table profile={shallow} columns={columns} layers={layers}>
        <Row>
          <Button onClick={() => picture.current && void savePicture(picture.current, layers, store)}>
            {t("profile.png")}
          </Button>
          <Button onClick={() => void saveTable(profile, store)}>{t("profile.csv")}</Button>
        </Row>
      </Table>
    </div>
  );
}

const colourOf = (at: number): string => LAYER_COLOURS[at % LAYER_COLOURS.length] ?? "";

/** The profile at whole millimetres, below its files. */
function Table({
  profile: { depth_mm },
  columns,
  layers,
  children,
}: {
  readonly profile: Profile;
  readonly columns: readonly (readonly number[])[];
  readonly layers: readonly LayerCurves[];
  readonly children: ComponentChildren;
}) {
  const mirrored = t("profile.mirrored");
  const names = layers.flatMap(({ name }) => [name, `${name}, ${mirrored}`]);
  const titles = [t("profile.axis"), t("profile.own"), mirrored, ...names];
  return (
    <details
      class="as-table"
      open={isTableOpen.value}
      onToggle={({ currentTarget }) => (isTableOpen.value = currentTarget.open)}
    >
      <summary>{t("profile.table")}</summary>
      {children}
      <table>
        <thead>
          <tr>
            {titles.map((words) => (
              <th key={words} scope="col">
                {words}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {depth_mm.map((depth, index) =>
            depth % 1 !== 0 ? null : (
              <tr key={depth}>
                <th scope="row">{number(depth, 1)}</th>
                {columns.map((of) => (
                  <td>{greyWords(of[index])}</td>
                ))}
              </tr>
            ),
          )}
        </tbody>
      </table>
    </details>
  );
}

/** The height of a line of the legend in a saved chart. */
const LEGEND_PIXELS = 20;

/** Saves the chart at four times its size on the screen. */
async function savePicture(
  chart: SVGSVGElement,
  layers: readonly LayerCurves[],
  { shown, drawn: state }: Store,
): Promise<void> {
  const { width, height } = chart.getBoundingClientRect();
  const page = getComputedStyle(document.body);
  // The own ones of the layers, then the two sides.
  const curves = chart.querySelectorAll(".curve:not(.layer.other)");
  const words = [...layers.map((layer) => layer.words), t("profile.mirrored"), t("profile.own")];
  const caption = await captionOf(shown, state.peek());
  const frame = { width, height: height + words.length * LEGEND_PIXELS, ratio: 4, caption };
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
  saveFile(png, `${fileStem(shown)}-profile.png`);
}

async function saveTable(profile: Profile, { shown, point, drawn }: Store): Promise<void> {
  const measured = point.measured.peek();
  const layers = measured ? layerCurves(measured, Infinity) : [];
  const csv = profileCsv(profile, layers, await captionOf(shown, drawn.peek()));
  // A spreadsheet recognises UTF-8 by the mark.
  saveFile(new Blob(["\ufeff", csv], { type: "text/csv" }), `${fileStem(shown)}-profile.csv`);
}
