// The query of the address. It names a patient's study: this module is the first to run, and takes it out of the address
// and of the history of the browser.

import { takeChoice } from "../base/launched.ts";

/** Whether the page of a case has led back here, to choose another head of the same study. */
export const isChoice = location.search === "?choose";
export const launchQuery = isChoice ? takeChoice() : location.search;
history.replaceState(null, "", location.pathname);
