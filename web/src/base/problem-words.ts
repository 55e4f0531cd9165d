// What went wrong, in the page's language where it has words for it, else in the server's.

import { Problem } from "./api.ts";
import { known, spoken, t } from "./i18n.ts";

/** The server's words with a capital letter and a full stop; the names of parameters, which it marks as code, are quoted. */
export function sentence(words: string): string {
  const quoted = words.replaceAll(/`([^`]*)`/g, "“$1”");
  const first = quoted.slice(0, 1).toUpperCase() + quoted.slice(1);
  return /[.!?…]$/.test(first) ? first : `${first}.`;
}

/** What a pane says of a problem; nothing where there is none, or where the page says it: the server is silent. */
export const troubleWords = (problem: unknown): string =>
  problem === null || (problem instanceof Problem && problem.kind === "unreachable") ? "" : problemWords(problem);

export function problemWords(problem: unknown): string {
  if (!(problem instanceof Problem)) return t("problem.unexpected");
  const key = known(`problem.${problem.kind}`);
  const reason = known(`reason.${problem.reason}`);
  if (key && reason) return `${t(key)} ${t(reason)}`;
  if (key && (spoken() !== "en" || !problem.detail)) return withNumbers(t(key), problem.detail);
  if (problem.detail) return t("problem.english", { detail: sentence(problem.detail) });
  return t("problem.status", { status: problem.status });
}

/** The page's words and behind them the server's, if those have numbers: which slice, how large. */
export const withNumbers = (words: string, detail: string): string =>
  /\d/.test(detail) ? `${words} (${t("problem.english", { detail: sentence(detail) })})` : words;
