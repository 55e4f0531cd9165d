// What the page that opens the case of a study and the page of the case leave to each other: in the storage of the tab, until
// it is read, because it names a patient's study.

import { parsed } from "../model/text.ts";
import { taken } from "./kept.ts";

/** A case that was opened although others fit as well. */
export interface Launched {
  readonly id: string;
  /** How many others there are. */
  readonly others: number;
  /** The query that all of them fit. */
  readonly query: string;
}

/** Leaves what was opened to the page of the case. */
export const leaveLaunch = (launched: Launched): void => sessionStorage.setItem("launched", JSON.stringify(launched));

/** Takes what was left; null if nothing was. */
export function takeLaunch(): Launched | null {
  return parsed(taken("launched")) as Launched | null;
}

/** Leaves a query to the page that shows the choice. */
export const leaveChoice = ({ query }: Launched): void => sessionStorage.setItem("choice", query);

/** Takes that query; empty if there is none. */
export const takeChoice = (): string => taken("choice");
