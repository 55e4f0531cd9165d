// The page: the list of cases at one side, the chosen case in the middle, its controls at the other side.

import { render } from "preact";

import { onReach } from "../base/api.ts";
import { App } from "./app.ts";
import { begin } from "./begin.ts";
import { hearDrops } from "./drops.ts";
import { Frame } from "./frame.tsx";

/** Runs the document. */
export async function reading(): Promise<void> {
  const place = await begin("app");
  const app = new App();
  render(<Frame app={app} />, place);
  onReach((isReachable) => app.reach(isReachable));
  hearDrops(document.body, (files, onto) => void app.drop(files, onto));
  window.addEventListener("popstate", () => void app.addressChanged());
  window.addEventListener("keydown", (event) => app.key(event));
  for (const name of ["keyup", "blur"]) window.addEventListener(name, () => app.release());
  await app.start();
}
