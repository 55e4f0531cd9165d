// What the server's neighbour of a PACS adds to a case from DICOM: its script has the patient's banner and the results.

import { send } from "../base/api.ts";
import { h } from "../base/dom.ts";
import { pictureBody } from "../model/series.ts";
import type { OnScreen } from "./export.ts";

/** Beside this script; not a part of the page. */
const SCRIPT: string = "./pacs.js";

/** Adds to the viewer and the panel beside it what there is to add; without the script, nothing. */
export async function meetNeighbour(viewer: HTMLElement, view: () => OnScreen): Promise<void> {
  const render = (side: number): unknown => pictureBody(view().state, [side, side]);
  await (await import(SCRIPT)).attach({ id: view().shown.id, h, send, render, viewer });
}
