// The query of the address. It names a patient's study: this module is the first to run, and takes it out of the address
// and of the history of the browser.

import { leaveAside, takeAside, takeChoice } from "../base/launched.ts";

/** Whether the page of a case has led back here, to choose another head of the same study. */
export const isChoice = location.search === "?choose";
export const launchQuery = isChoice ? takeChoice() : location.search || takeAside();
history.replaceState(null, "", location.pathname);

/** Leaves the query in the tab while somebody signs in. */
export const leaveQuery = (): void => leaveAside(launchQuery);

export const takeQuery = (): void => void takeAside();
