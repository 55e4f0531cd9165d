// Many pictures in one file, drawn by the server: a contact sheet, a turn, a sweep.

import { postForFile } from "../base/api.ts";
import { h, quiet, status } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { readDepths } from "../model/query.ts";
import { SHEET_VIEWS, sheetBody, sweepBody, turnBody } from "../model/series.ts";
import type { Vec2 } from "../model/space.ts";
import { clampDepth } from "../model/state.ts";
import type { SweepChoice } from "../model/sweep.ts";
import { closing, open } from "./dialogs.ts";
import { type OnScreen, fileStem } from "./export.ts";
import { saveFile } from "./picture-file.ts";

const KINDS = ["sheet", "turn", "sweep"] as const;
type Kind = (typeof KINDS)[number];

/** Pixels of a picture's side: of a sheet's, and of a moving one's. */
const SHEET_PIXELS = 320;
const MOVING_PIXELS = 480;
const TURN_PICTURES = 72;
const SWEEP_STEP_MM = 0.5;

/** Lets choose what is drawn and saves it. */
export function seriesDialog({ shown, state, surface }: OnScreen, sweep: SweepChoice): void {
  const kind = h(
    "select",
    { id: "series-kind", change: () => showFields() },
    ...KINDS.map((one) => h("option", { value: one }, t(`series.${one}`))),
  );
  const deepest_mm = clampDepth(Infinity, shown);
  const depths = h("input", {
    type: "text",
    id: "series-depths",
    value: [5, 10, 15, 20].filter((d) => d <= deepest_mm).join(", "),
  });
  const seconds = h("input", { type: "number", min: 1, max: 60, step: 1, value: 6 });
  const fields: Readonly<Record<Kind, HTMLElement>> = {
    sheet: h("label", {}, t("series.depths"), depths),
    turn: h("label", {}, t("series.seconds"), seconds),
    sweep: h(
      "p",
      { class: "quiet" },
      t("series.sweep-text", {
        from: number(sweep.from_mm, 1),
        to: number(sweep.to_mm, 1),
        speed: number(sweep.mm_per_s),
      }),
    ),
  };
  const showFields = (): void => {
    for (const one of KINDS) fields[one].hidden = one !== kind.value;
  };
  const said = status();
  const make = h("button", { type: "button", class: "primary", click: () => void save() }, t("series.make"));
  const size = movingSize(surface.size());
  const bodyOf = (wanted: Kind): unknown => {
    const asked = surface.surface.served(state);
    if (wanted === "sweep") return sweepBody(asked, sweep, SWEEP_STEP_MM, size);
    if (wanted === "turn") {
      const lasts = Math.min(Math.max(seconds.valueAsNumber || 6, 1), 60);
      return turnBody(asked, TURN_PICTURES, Math.round((1000 * lasts) / TURN_PICTURES), size);
    }
    const wished = readDepths(depths.value, deepest_mm);
    return wished && sheetBody(asked, wished, SHEET_VIEWS, SHEET_PIXELS);
  };
  const save = async (): Promise<void> => {
    const wanted = KINDS.find((one) => one === kind.value) ?? "sheet";
    const body = bodyOf(wanted);
    if (!body) {
      said.textContent = t("series.bad-depths", { deepest: number(deepest_mm, 1) });
      return;
    }
    make.disabled = true;
    said.textContent = t("series.drawing");
    try {
      saveFile(await postForFile(`v1/cases/${shown.id}/renders`, body), `${fileStem(shown)}-${wanted}.png`);
      said.textContent = t("series.saved");
    } catch (problem) {
      said.textContent = problemWords(problem);
    }
    make.disabled = false;
  };
  showFields();
  open(
    t("series.title"),
    "series",
    h("label", {}, t("series.kind"), kind),
    ...KINDS.map((one) => fields[one]),
    quiet(t("series.text")),
    said,
    h("div", { class: "row end" }, closing("close", t("close")), make),
  );
}

/** The pane's shape in few pixels: a film has many pictures. */
function movingSize([width, height]: Vec2): Vec2 {
  const factor = MOVING_PIXELS / Math.max(width, height, 1);
  return [Math.max(Math.round(width * factor), 128), Math.max(Math.round(height * factor), 128)];
}
