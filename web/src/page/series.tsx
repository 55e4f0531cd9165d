// Many pictures in one file, drawn by the server: a contact sheet, a turn, a sweep.

import { VIEW_NAMES } from "../model/camera.ts";
import { useState } from "preact/hooks";

import { postForFile } from "../base/api.ts";
import { number, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { readDepths } from "../model/query.ts";
import { sheetBody, sweepBody, turnBody } from "../model/series.ts";
import { type Vec2, clamp } from "../model/space.ts";
import { clampDepth } from "../model/state.ts";
import type { SweepChoice } from "../model/sweep.ts";
import { Closing, End, open } from "./dialogs.tsx";
import { type OnScreen, fileStem } from "./export.ts";
import { LabelledChoice, Quiet, Status } from "./fields.tsx";
import { saveFile } from "./picture-file.ts";

const KINDS = ["sheet", "turn", "sweep"] as const;
type Kind = (typeof KINDS)[number];

/** Pixels of a picture's side: of a sheet's, and of a moving one's. */
const SHEET_PIXELS = 320;
const MOVING_PIXELS = 480;
const TURN_PICTURES = 72;
const SWEEP_STEP_MM = 0.5;

/** Lets choose what is drawn and saves it. */
export function seriesDialog(onScreen: OnScreen, sweep: SweepChoice): void {
  void open(t("series.title"), "series", <Series onScreen={onScreen} sweep={sweep} />, null);
}

function Series({ onScreen, sweep }: { readonly onScreen: OnScreen; readonly sweep: SweepChoice }) {
  const { shown, state, surface } = onScreen;
  const deepest_mm = clampDepth(Infinity, shown);
  const [kind, setKind] = useState<Kind>("sheet");
  const [depths, setDepths] = useState([5, 10, 15, 20].filter((depth) => depth <= deepest_mm).join(", "));
  const [seconds, setSeconds] = useState(6);
  const [said, say] = useState("");
  const [isBusy, setBusy] = useState(false);

  const bodyOf = (): unknown => {
    const asked = surface.surface.served(state);
    const size = movingSize(surface.size());
    if (kind === "sweep") return sweepBody(asked, sweep, SWEEP_STEP_MM, size);
    if (kind === "turn")
      return turnBody(asked, TURN_PICTURES, Math.round((1000 * clamp(seconds || 6, 1, 60)) / TURN_PICTURES), size);
    const wished = readDepths(depths, deepest_mm);
    return wished && sheetBody(asked, wished, VIEW_NAMES, SHEET_PIXELS);
  };
  const save = async (): Promise<void> => {
    const body = bodyOf();
    if (!body) return say(t("series.bad-depths", { deepest: number(deepest_mm, 1) }));
    setBusy(true);
    say(t("series.drawing"));
    try {
      saveFile(await postForFile(`v1/cases/${shown.id}/renders`, body), `${fileStem(shown)}-${kind}.png`);
      say(t("export.file-saved"));
    } catch (problem) {
      say(problemWords(problem));
    }
    setBusy(false);
  };
  return (
    <>
      <LabelledChoice
        id="series-kind"
        label={t("series.kind")}
        values={KINDS}
        value={kind}
        words={(one) => t(`series.${one}`)}
        onChoose={(one) => setKind(one)}
      />
      {kind === "sheet" && (
        <label>
          {t("series.depths")}
          <input
            type="text"
            id="series-depths"
            value={depths}
            onInput={({ currentTarget }) => setDepths(currentTarget.value)}
          />
        </label>
      )}
      {kind === "turn" && (
        <label>
          {t("series.seconds")}
          <input
            type="number"
            min={1}
            max={60}
            step={1}
            value={seconds}
            onInput={({ currentTarget }) => setSeconds(currentTarget.valueAsNumber)}
          />
        </label>
      )}
      {kind === "sweep" && (
        <Quiet>
          {t("series.sweep-text", {
            from: number(sweep.from_mm, 1),
            to: number(sweep.to_mm, 1),
            speed: number(sweep.mm_per_s),
          })}
        </Quiet>
      )}
      <Quiet>{t("series.text")}</Quiet>
      <Status words={said} />
      <End>
        <Closing />
        <button type="button" class="primary" disabled={isBusy} onClick={() => void save()}>
          {t("series.make")}
        </button>
      </End>
    </>
  );
}

/** The pane's shape in few pixels: a film has many pictures. */
function movingSize([width, height]: Vec2): Vec2 {
  const factor = MOVING_PIXELS / Math.max(width, height, 1);
  return [Math.max(Math.round(width * factor), 128), Math.max(Math.round(height * factor), 128)];
}
