// What a named user has chosen and saved: the server keeps it for them in whatever browser they sit; the browser has a copy.

import { batch, effect } from "@preact/signals";

import { Problem, send } from "../base/api.ts";
import { t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { readLayouts } from "../model/saved-layouts.ts";
import { note } from "./announce.ts";
import { isNamed } from "./holder.ts";
import { choose, preferences, readPreferences } from "./preferences.ts";
import { ownSteps, savedLayouts, takeLayouts, takeSteps } from "./saved-layouts.ts";

const PATH = "v1/preferences";

const chosen = () => ({ choices: preferences.value, layouts: savedLayouts.value, steps: ownSteps.value });
type Chosen = ReturnType<typeof chosen>;

/** As the server has it; what is absent was never kept. */
let kept: Readonly<Partial<Record<keyof Chosen, unknown>>> = {};
let tag = "";
let last: Promise<void> = Promise.resolve();

async function take(answer: Response): Promise<void> {
  tag = answer.headers.get("etag") ?? "";
  kept = (await answer.json()) as typeof kept;
}

const read = async (): Promise<void> => take(await send(PATH, { cache: "no-store" }));

/** Keeps what has changed, whatever other windows of the user have changed besides. */
async function store(changed: Partial<Chosen>): Promise<void> {
  for (;;) {
    const body = JSON.stringify({ ...kept, ...changed });
    try {
      // The page may be left at once.
      return await take(await send(PATH, { method: "PUT", headers: { "if-match": tag }, body, keepalive: true }));
    } catch (problem) {
      if (!(problem instanceof Problem) || problem.status !== 412) throw problem;
      await read();
    }
  }
}

/** Takes over what the server keeps for whoever is signed in, and from then on keeps there what changes. */
export async function followPerson(): Promise<void> {
  if (!isNamed.peek()) return;
  try {
    await read();
  } catch {
    // The browser has a copy.
    return;
  }
  batch(() => {
    if (kept.choices) choose(readPreferences(kept.choices));
    if (kept.layouts) takeLayouts(readLayouts(kept.layouts));
    if (kept.steps) takeSteps(readLayouts(kept.steps));
  });
  let before = chosen();
  effect(() => {
    const now = chosen();
    const parts = (Object.keys(now) as (keyof Chosen)[]).filter((part) => now[part] !== before[part]);
    before = now;
    if (parts.length === 0) return;
    const changed = Object.fromEntries(parts.map((part) => [part, now[part]]));
    const unsaved = (problem: unknown): void => note(t("choices.unsaved", { why: problemWords(problem) }));
    last = last.then(() => store(changed)).catch(unsaved);
  });
}

/** Resolves once the server has what was changed by now. */
export async function isKept(): Promise<void> {
  // Whoever follows the same change may not have heard of it yet.
  await Promise.resolve();
  await last;
}
