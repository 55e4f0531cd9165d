// What all documents of the page begin with.

import { effect } from "@preact/signals";

import { onTokenWanted } from "../base/api.ts";
import { h } from "../base/dom.ts";
import { learn } from "../base/i18n.ts";
import { preferences } from "../store/preferences.ts";
import { askToken } from "./dialogs.tsx";

/** Resolves to where the page is rendered, once its language is spoken. */
export async function begin(name: string): Promise<HTMLElement> {
  effect(() => void (document.documentElement.dataset.theme = preferences.value.theme));
  onTokenWanted(askToken);
  const { language } = preferences.peek();
  await learn(language);
  document.documentElement.lang = language;
  const place = h("div", { class: name });
  document.body.append(place);
  return place;
}
