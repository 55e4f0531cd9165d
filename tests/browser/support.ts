// What the tests in a real browser share: the program itself on a free port, and Debian's Chromium with WebGL2 in
// software.
//
// Needs the built program (ISOCORTEX_BINARY, else target/debug/isocortex) and Chromium; without the latter the tests
// are skipped, but on CI (CI=true) they fail. Screenshots are left in target/browser/. ISOCORTEX_PAGE=web/dist shows
// the page as it has just been bundled instead of the one in the program, which saves a build of the program while
// working on the page.

import assert from "node:assert/strict";
import { type ChildProcess, execFileSync, spawn } from "node:child_process";
import { once } from "node:events";
import { existsSync } from "node:fs";
import { cp, mkdir, mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { createInterface } from "node:readline";
import { inspect } from "node:util";

import {
  type Browser,
  type BrowserContext,
  type BrowserContextOptions,
  type Locator,
  type Page,
  chromium,
} from "playwright-core";

/** The root of the checkout; the tests run bundled, from web/build/browser/. */
export const ROOT = path.join(import.meta.dirname, "../../..");
const PROGRAM = path.resolve(ROOT, process.env.ISOCORTEX_BINARY || "target/debug/isocortex");
export const PICTURES = path.join(ROOT, "target/browser");

/** The path of a Chromium, or null where none is installed. */
function findChromium(): string | null {
  try {
    return execFileSync(path.join(ROOT, "scripts/chromium.sh"), { encoding: "utf8" }).trim();
  } catch {
    return null;
  }
}

const executable = findChromium();
/** Why the tests cannot run here; false where they can. */
export const skip = !executable && process.env.CI !== "true" ? "no Chromium is installed" : false;
if (skip) console.error(`SKIPPED: ${skip}; install the package chromium or set CHROMIUM`);

// WebGL2 in software, so that the tests draw the same where there is a graphics card and where there is none. All else
// of the page is drawn without it, as Chromium itself does without a card: by WebGL2 in software, that took most of the
// time of these tests.
const FLAGS = [
  "--use-angle=swiftshader",
  "--enable-unsafe-swiftshader",
  "--disable-gpu-compositing",
  "--no-sandbox",
  "--disable-dev-shm-usage",
  "--disable-quic",
  "--force-color-profile=srgb",
  "--font-render-hinting=none",
];

/**
 * The head to test with: Colin27 of the test data or of Debian's mricron-data, as the demo finds it; else a phantom.
 */
export function headOfDemo(): Record<string, string> {
  const head = process.env.ISOCORTEX_DEMO_VOLUME;
  const mask = process.env.ISOCORTEX_DEMO_MASK;
  if (head) return { ISOCORTEX_DEMO_VOLUME: head, ...(mask ? { ISOCORTEX_DEMO_MASK: mask } : {}) };
  const folder = folderOfColin();
  if (folder) {
    return {
      ISOCORTEX_DEMO_VOLUME: path.join(folder, "ch2.nii.gz"),
      ISOCORTEX_DEMO_MASK: path.join(folder, "ch2bet.nii.gz"),
    };
  }
  console.error("there is no real head; the tests use the phantom");
  return {};
}

function folderOfColin(): string | null {
  const data = process.env.ISOCORTEX_TEST_DATA ?? path.join(ROOT, "../shared/data");
  if (existsSync(path.join(data, "colin27/ch2bet.nii.gz"))) return path.join(data, "colin27");
  try {
    // Finds it, or unpacks it into the checkout; ISOCORTEX_NO_INSTALL=1 or a missing network leave nothing.
    return execFileSync(path.join(ROOT, "scripts/head.sh"), {
      encoding: "utf8",
      stdio: ["ignore", "pipe", "ignore"],
    }).trim();
  } catch {
    return null;
  }
}

/** A running server. */
export interface Server {
  readonly address: string;
  readonly child: ChildProcess;
  stop(signal?: NodeJS.Signals): Promise<void>;
}

export interface ServerOptions {
  /** `demo` prepares the demo's head, `serve` starts empty. */
  readonly command: "demo" | "serve";
  readonly data: string;
  /** 0 takes a free one. */
  readonly port?: number;
  /** Further words of the command. */
  readonly options?: readonly string[];
}

/** Starts the program and waits until it says where it listens. */
export async function startServer({ command, data, port = 0, options = [] }: ServerOptions): Promise<Server> {
  // Nothing of the machine's own configuration: the program as a newcomer sees it.
  const env = Object.fromEntries(Object.entries(process.env).filter(([name]) => !name.startsWith("ISOCORTEX_")));
  const head = command === "demo" ? headOfDemo() : {};
  const child = spawn(PROGRAM, [command, ...options], {
    stdio: ["ignore", "pipe", "pipe"],
    env: { ...env, ...head, ISOCORTEX_CREATE: "true", ISOCORTEX_DATA: data, ISOCORTEX_LISTEN: `127.0.0.1:${port}` },
  });
  const said: string[] = [];
  const address = await new Promise<string>((resolve, reject) => {
    child.on("error", reject);
    child.on("exit", (code) => reject(new Error(`the server ended with ${code}:\n${said.join("\n")}`)));
    for (const stream of [child.stdout, child.stderr]) {
      createInterface({ input: stream }).on("line", (line) => {
        said.push(line);
        const found = /http:\/\/[^\s"]+/.exec(line);
        if (found) resolve(found[0]);
      });
    }
  });
  return {
    address,
    child,
    async stop(signal = "SIGTERM") {
      if (child.exitCode !== null || child.signalCode !== null) return;
      child.kill(signal);
      await once(child, "exit");
    },
  };
}

/** A folder that is removed by `clean`. */
export async function scratchFolder(): Promise<{ readonly folder: string; clean(): Promise<void> }> {
  const folder = await mkdtemp(path.join(tmpdir(), "isocortex-page-"));
  return { folder, clean: () => rm(folder, { recursive: true, force: true }) };
}

/** Debian's Chromium, headless. */
export async function launchBrowser(): Promise<Browser> {
  assert.ok(executable, "no Chromium is installed, which CI needs");
  return chromium.launch({ executablePath: executable, headless: true, args: FLAGS });
}

/** What the tests of a file share. */
export interface Stage {
  /** For files that the tests write. The server's own are in `data` below it. */
  readonly folder: string;
  readonly data: string;
  /** A test that starts the server again puts the new one here. */
  server: Server;
  readonly browser: Browser;
  /** Stops both, and removes the folder. */
  end(): Promise<void>;
}

/**
 * Starts a browser, and a server whose store no other file has; `writeOptions` writes the files that the options of
 * the server name. The store of a demo is a copy of ISOCORTEX_PREPARED_DEMO where that is set, so that its head is
 * prepared once for all files (`prepare.ts`).
 */
export async function startStage(
  command: "demo" | "serve",
  writeOptions: (folder: string) => Promise<readonly string[]> = async () => [],
  port = 0,
): Promise<Stage> {
  const { folder, clean } = await scratchFolder();
  const data = path.join(folder, "data");
  let browser: Browser | undefined;
  try {
    browser = await launchBrowser();
    const prepared = process.env.ISOCORTEX_PREPARED_DEMO;
    if (command === "demo" && prepared) await cp(path.resolve(ROOT, prepared), data, { recursive: true });
    const server = await startServer({ command, data, port, options: await writeOptions(folder) });
    const stage: Stage = {
      folder,
      data,
      server,
      browser,
      async end() {
        await stage.browser.close();
        await stage.server.stop();
        await clean();
      },
    };
    return stage;
  } catch (error) {
    await browser?.close();
    await clean();
    throw error;
  }
}

/** Writes a file of settings, and returns the options that name it. */
export async function configured(folder: string, settings: string): Promise<readonly string[]> {
  const file = path.join(folder, "isocortex.toml");
  await writeFile(file, settings);
  return ["--config", file];
}

/** A page of a context of its own, with what went wrong in it: exceptions, console errors, refusals of the policy. */
export interface Watched {
  readonly page: Page;
  readonly context: BrowserContext;
  readonly troubles: string[];
}

/**
 * A quarter of the pixels, on the same page: what software draws for a test that judges words, places and lists, and
 * no pixel of the surface. Drawing takes most of the time of these tests.
 */
export const COARSE: BrowserContextOptions = { deviceScaleFactor: 0.5 };

export async function openPage(
  browser: Browser,
  options: BrowserContextOptions = {},
  task: "read" | "images" | "case" = "read",
): Promise<Watched> {
  const context = await browser.newContext({ viewport: { width: 1440, height: 900 }, locale: "en-GB", ...options });
  // As long as a busy machine may take: what comes at all comes much sooner.
  context.setDefaultTimeout(180_000);
  await servePage(context);
  const close = context.close.bind(context);
  // Answers that a test still changes when it ends are nobody's.
  context.close = async () => {
    for (const routed of [...context.pages(), context]) await routed.unrouteAll({ behavior: "ignoreErrors" });
    await close();
  };
  // The usual controls can be reached at once, unless a test is about the tabs of the panel.
  if (!options.storageState)
    await context.addInitScript((first) => {
      // Documents of their own origin, such as saved files, have none.
      if (origin !== "null")
        localStorage["isocortex"] ??= JSON.stringify({
          task: first,
          list: innerWidth >= 1200,
          unfolded: ["list", "point", "layers", "view"].map((one) => `panel.${one}`),
        });
    }, task);
  const page = await context.newPage();
  const troubles: string[] = [];
  // Playwright's init scripts are not the page's: the policy lets them be, and hears of all that is the page's.
  await page.addInitScript(() => {
    document.addEventListener("securitypolicyviolation", (event) =>
      console.error(`policy: ${event.violatedDirective} ${event.blockedURI}`),
    );
  });
  page.on("pageerror", (error) => troubles.push(error.stack ?? error.message));
  page.on("console", (message) => {
    if (message.type() === "error") troubles.push(`${message.text()} ${message.location().url}`);
  });
  return { page, context, troubles };
}

/** Puts the files of ISOCORTEX_PAGE in the place of the program's own, under the program's own headers. */
async function servePage(context: BrowserContext): Promise<void> {
  const folder = process.env.ISOCORTEX_PAGE;
  if (!folder) return;
  const read = (name: string): Promise<Buffer> => readFile(path.resolve(ROOT, folder, name));
  const { documents, hashed } = JSON.parse(String(await read("manifest.json"))) as {
    readonly documents: readonly { readonly address: string; readonly file: string }[];
    readonly hashed: readonly string[];
  };
  const files = new Map([
    ...documents.map(({ address, file }) => [address, file] as const),
    ...hashed.map((file) => [`/${file}`, file] as const),
  ]);
  const types: Readonly<Record<string, string>> = { css: "text/css", html: "text/html", js: "text/javascript" };
  await context.route(
    (url) => files.has(url.pathname),
    async (route) => {
      const url = new URL(route.request().url());
      const name = files.get(url.pathname) ?? "";
      // The program has other names for the parts of its own page; the headers of a document hold for all of it.
      const response = await route.fetch({ url: new URL("/", url).href });
      const contentType = `${types[path.extname(name).slice(1)] ?? "application/json"}; charset=utf-8`;
      await route.fulfill({ response, contentType, body: await read(name) });
    },
  );
}

/** Keeps what the page looks like, for people to look at. */
export async function keep(page: Page, name: string): Promise<void> {
  await mkdir(PICTURES, { recursive: true });
  await page.screenshot({ path: path.join(PICTURES, `${name}.png`) });
}

/** The first ready case's id, waited for. */
export async function readyCase(address: string, seconds = 480): Promise<string> {
  const deadline = Date.now() + 1000 * seconds;
  for (;;) {
    const { cases } = (await (await fetch(new URL("v1/cases", address))).json()) as {
      cases: { id: string; state: string }[];
    };
    const ready = cases.find((one) => one.state === "ready");
    if (ready) return ready.id;
    assert.ok(Date.now() < deadline, "no case is ready");
    await new Promise((resolve) => setTimeout(resolve, 200));
  }
}

/** A finding as the server keeps it. */
export interface StoredFinding {
  readonly id: string;
  readonly kind: string;
  readonly points_in_patient: readonly (readonly number[])[];
  readonly depth_mm: number;
  readonly side: string;
  readonly label: string;
  readonly note: string;
  readonly certainty?: string;
  readonly author?: string;
  readonly from_map?: string;
  readonly is_dismissed: boolean;
  readonly is_unconfirmed?: true;
}

/** The findings of a case, as the server has them now. */
export async function findingsOf(
  { address }: Pick<Server, "address">,
  id: string,
  headers: Readonly<Record<string, string>> = {},
): Promise<readonly StoredFinding[]> {
  const answer = await fetch(new URL(`v1/cases/${id}/findings`, address), { headers });
  return ((await answer.json()) as { findings: readonly StoredFinding[] }).findings;
}

/**
 * Where the pixels are that are at least so bright: as shares of the picture, their mean place and their leftmost
 * one.
 */
export interface Bright {
  readonly x: number;
  readonly y: number;
  readonly least_x: number;
  readonly count: number;
}

/** The grey pixels of a picture that are at least so bright; null where none is. */
export async function brightest(page: Page, png: Buffer, least: number): Promise<Bright | null> {
  return page.evaluate(
    async ([base64, threshold]) => {
      const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
      const image = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
      const canvas = new OffscreenCanvas(image.width, image.height);
      const context = canvas.getContext("2d");
      if (!context) return null;
      context.drawImage(image, 0, 0);
      const { data } = context.getImageData(0, 0, image.width, image.height);
      let [count, x, y, least_x] = [0, 0, 0, image.width];
      for (let at = 0; at < data.length; at += 4) {
        // Grey alone: letters, lines and contours are coloured.
        const [red = 0, green = 0, blue = 0] = data.subarray(at, at + 3);
        if (red < threshold || Math.abs(red - blue) > 4 || Math.abs(red - green) > 4) continue;
        count += 1;
        x += ((at / 4) % image.width) + 0.5;
        least_x = Math.min(least_x, (at / 4) % image.width);
        y += Math.floor(at / 4 / image.width) + 0.5;
      }
      return count > 0
        ? { x: x / count / image.width, y: y / count / image.height, least_x: least_x / image.width, count }
        : null;
    },
    [png.toString("base64"), least] as const,
  );
}

/** Waits until the surface's first picture stands, and everything of the case has come. */
export async function shown(page: Page): Promise<void> {
  await page.waitForSelector("#surface[data-drawn=true]");
  await page.waitForSelector(".viewer[data-loaded=true]");
}

/** Waits until the address says what is shown, which it does when the state has rested. */
export async function rested(page: Page): Promise<void> {
  // What was just pressed is heard by the next frame.
  await page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
  await page.waitForSelector(".viewer[data-rested=true]");
}

/**
 * Asks again and again until an answer is good, and resolves to it. A wait that nothing ends fails with the last answer.
 */
export async function until<Value>(
  ask: () => Promise<Value>,
  isGood: (value: Value) => boolean,
  seconds = 120,
): Promise<Value> {
  const deadline = Date.now() + 1000 * seconds;
  for (;;) {
    const value = await ask();
    if (isGood(value)) return value;
    assert.ok(Date.now() < deadline, `after ${seconds} s the answer is still ${inspect(value)}`);
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
}

/** Opens the settings, chooses there, and closes them. */
export async function inSettings(page: Page, choose: () => Promise<unknown>): Promise<void> {
  await page.locator("#settings").click();
  await choose();
  await page.keyboard.press("Escape");
  await page.waitForSelector("dialog.settings", { state: "detached" });
}

/** Shows a tab of the panel. */
export const tab = (page: Page, name: "read" | "images" | "case"): Promise<void> =>
  page.locator(`.tasks button[value=${name}]`).click();

/** Opens the menu of a tool over the pictures; another one that is open closes. */
export async function openMenu(page: Page, name: "window" | "ruler" | "maps" | "export" | "slant"): Promise<Locator> {
  const menu = page.locator(`#menu-${name}`);
  if (!(await menu.isVisible())) await page.locator(`[popovertarget=menu-${name}]`).click();
  return menu;
}

/** Has the page in a language, which loads it again. */
export async function speak(page: Page, language: string): Promise<void> {
  if ((await page.locator("html").getAttribute("lang")) === language) return;
  await page.locator("#settings").click();
  await page.locator("#language").selectOption(language);
  await page.waitForSelector(`html[lang=${language}] .app`);
}

/** Types a depth into its box. */
export async function typeDepth(page: Page, depth_mm: number): Promise<void> {
  await page.locator("#depth-number").fill(String(depth_mm));
  await page.keyboard.press("Enter");
}

/** The parts of the address's fragment: `id` and the rest by key. */
export async function fragment(page: Page): Promise<Record<string, string>> {
  await rested(page);
  const [id = "", ...pairs] = new URL(page.url()).hash.slice(1).split("&");
  return { id, ...Object.fromEntries(pairs.map((pair) => pair.split("=", 2) as [string, string])) };
}
