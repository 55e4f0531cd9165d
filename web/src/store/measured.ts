// What the server measures at the marked point and at its mirrored one: the width of the junction, and the layers.

import { listLayers, send } from "../base/api.ts";
import { known, number, t } from "../base/i18n.ts";
import type { Curve, Measured, PointMeasured, SidedCurves } from "../model/profile.ts";
import { isBusy } from "../model/layers.ts";
import type { SurfaceName } from "../model/surfaces.ts";
import { wait } from "../base/patience.ts";
import { patiently } from "./case-layers.ts";

/** How long a point rests before the server is asked about it, and asked again while something is being made. */
const REST_MS = 500;

/** The server's answer about a point (LPS mm); it waits for the maps. */
export async function measuredAt(
  id: string,
  position: readonly number[],
  surface: SurfaceName,
  signal: AbortSignal,
): Promise<Measured> {
  // A list tells without an error that something is still being made.
  do {
    await wait(REST_MS);
    signal.throwIfAborted();
  } while ((await listLayers(id)).layers.some(isBusy));
  const of = surface === "whole" ? "" : `&surface=${surface}`;
  const path = `v1/cases/${id}/profile?position=${position.map((part) => part.toFixed(2)).join(",")}${of}`;
  return (await patiently(() => send(path, { signal }), signal)).json() as Promise<Measured>;
}

const widthOf = ({ junction_width: { verdict, mm } }: PointMeasured): string => {
  const key = known(`width.${verdict}`);
  return mm !== undefined ? `${number(mm, 1)} mm` : key ? t(key) : "–";
};

/** The width of the junction on both sides, in words; empty if the case has no maps. */
export function widthWords({ own, mirrored, maps_undefined }: Measured): string {
  if (maps_undefined) return "";
  return t("profile.both", { own: widthOf(own), mirrored: mirrored ? widthOf(mirrored) : "–" });
}

/** The curves of a layer, as they are plotted. */
export interface LayerCurves extends SidedCurves {
  readonly words: string;
  /** Its own scale: the least and the greatest value down to a depth. */
  readonly range: readonly [number, number];
}

/** The curves of all layers but labels, which have names for values. */
export function layerCurves({ own, mirrored, layers = [] }: Measured, deepest_mm: number): LayerCurves[] {
  return layers.flatMap(({ name, unit, labels }, at) => {
    const curve = (side: PointMeasured | undefined): Curve =>
      (side?.samples ?? []).flatMap(({ depth_mm, layers: values }) => {
        const value = values?.[at] ?? NaN;
        return depth_mm !== null && depth_mm <= deepest_mm ? [[depth_mm, value] as const] : [];
      });
    const curves = [curve(own), curve(mirrored)] as const;
    const values = curves.flatMap((one) => one.map(([, value]) => value)).filter(Number.isFinite);
    if (labels || values.length === 0) return [];
    const range = [Math.min(...values), Math.max(...values)] as const;
    const [from, to] = [number(range[0], 2), number(range[1], 2)];
    const words = t("profile.range", { name, from, to, unit }).trim();
    return [{ name, words, own: curves[0], mirrored: curves[1], range }];
  });
}
