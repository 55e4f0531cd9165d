// The page: the list of cases at one side, the chosen case in the middle, its controls at the other side.

import { effect } from "@preact/signals";
import { render } from "preact";

import { onReach, onTokenWanted } from "../base/api.ts";
import { h } from "../base/dom.ts";
import { learn } from "../base/i18n.ts";
import { preferences } from "../store/preferences.ts";
import { App } from "./app.ts";
import { askToken } from "./dialogs.tsx";
import { hearDrops } from "./drops.ts";
import { Frame } from "./frame.tsx";

async function build(): Promise<void> {
  const { language } = preferences.peek();
  await learn(language);
  document.documentElement.lang = language;
  const app = new App();
  const place = h("div", { class: "app" });
  document.body.append(place);
  render(<Frame app={app} />, place);
  onReach((isReachable) => app.reach(isReachable));
  hearDrops(document.body, (files) => app.drop(files));
  window.addEventListener("popstate", () => void app.addressChanged());
  window.addEventListener("keydown", (event) => app.key(event));
  for (const name of ["keyup", "blur"]) window.addEventListener(name, () => app.release());
  await app.start();
}

effect(() => void (document.documentElement.dataset.theme = preferences.value.theme));
onTokenWanted(askToken);
void build();
