// The section of the panel that saves and shares what is on the screen.

import { h, setText, status } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import type { SweepChoice } from "../model/sweep.ts";
import { serverPictureDialog } from "./dialogs.ts";
import { type OnScreen, copied, copyPicture, savePicture } from "./export.ts";
import { button, choice, row } from "./fields.ts";
import { seriesDialog } from "./series.ts";

/** How many times the screen's pixels a saved picture can have. */
const TIMES = [1, 2, 4] as const;

interface ExportSources {
  onScreen(): OnScreen;
  sweep(): SweepChoice;
  /** The address of what is on the screen. */
  address(): string;
}

export function exportSection({ onScreen, sweep, address }: ExportSources): HTMLElement {
  const times = choice("times", t("export.times"), TIMES, (one) => `${one}×`);
  const note = status();
  /** Reports in words what becomes of a file. */
  const telling = (words: string, work: (view: OnScreen, times: number) => Promise<string>): HTMLElement =>
    button(words, () => {
      setText(note, t("export.working"));
      void work(onScreen(), Number(times.value)).then((said) => setText(note, said));
    });
  const buttons = [
    telling(t("export.screenshot"), savePicture),
    telling(t("export.copy-picture"), copyPicture),
    button(t("export.server"), () => serverPictureDialog(onScreen())),
    button(t("export.series"), () => seriesDialog(onScreen(), sweep())),
    telling(t("export.copy"), () => copied(address())),
  ];
  return h("div", { class: "group-body" }, row(times, ...buttons), note);
}
