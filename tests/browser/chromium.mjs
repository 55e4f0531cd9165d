// Drives Debian's Chromium over its debugging pipe: no package, no port.

import { execFileSync, spawn } from "node:child_process";
import { once } from "node:events";
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { setTimeout as sleep } from "node:timers/promises";

const FLAGS = [
  "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-dev-shm-usage", "--no-first-run",
  "--disable-background-networking", "--disable-component-update", "--disable-default-apps", "--disable-sync",
  "--disable-extensions", "--hide-scrollbars", "--force-color-profile=srgb", "--remote-debugging-pipe",
];

/** The path of a Chromium, or null where none is installed. */
export function findChromium() {
  try {
    return execFileSync(path.join(import.meta.dirname, "../../scripts/chromium.sh"), { encoding: "utf8" }).trim();
  } catch {
    return null;
  }
}

/** Starts Chromium with one blank page in a profile of its own. */
export async function launch(executable) {
  const profile = await mkdtemp(path.join(tmpdir(), "isocortex-browser-"));
  const child = spawn(executable, [...FLAGS, `--user-data-dir=${profile}`, "about:blank"], {
    stdio: ["ignore", "ignore", "ignore", "pipe", "pipe"],
    env: { ...process.env, HOME: profile, XDG_CONFIG_HOME: profile, XDG_CACHE_HOME: profile },
  });
  const pipe = new Pipe(child);
  const { targetInfos } = await pipe.ask("Target.getTargets");
  const { targetId } = targetInfos.find((target) => target.type === "page");
  const { sessionId } = await pipe.ask("Target.attachToTarget", { targetId, flatten: true });
  const page = new Page(pipe, sessionId);
  await page.enable();
  return {
    page,
    async close() {
      child.kill("SIGKILL");
      await once(child, "close");
      await rm(profile, { recursive: true, force: true, maxRetries: 5 });
    },
  };
}

/** The protocol: JSON messages, each ended by a zero byte, out on descriptor 3 and in on 4. */
class Pipe {
  #out;
  #waiting = new Map();
  #heard = [];
  #last = 0;

  constructor(child) {
    this.#out = child.stdio[3];
    let rest = Buffer.alloc(0);
    child.stdio[4].on("data", (chunk) => {
      rest = Buffer.concat([rest, chunk]);
      for (let end; (end = rest.indexOf(0)) >= 0; rest = rest.subarray(end + 1)) {
        this.#take(JSON.parse(rest.toString("utf8", 0, end)));
      }
    });
    child.on("exit", () => {
      for (const { reject } of this.#waiting.values()) reject(new Error("Chromium ended early"));
    });
  }

  ask(method, params = {}, sessionId = undefined) {
    const id = (this.#last += 1);
    this.#out.write(`${JSON.stringify({ id, method, params, sessionId })}\0`);
    return new Promise((resolve, reject) => this.#waiting.set(id, { method, resolve, reject }));
  }

  onEvent(listen) {
    this.#heard.push(listen);
  }

  #take(message) {
    if (message.id === undefined) {
      for (const listen of this.#heard) listen(message);
      return;
    }
    const { method, resolve, reject } = this.#waiting.get(message.id);
    this.#waiting.delete(message.id);
    if (message.error) reject(new Error(`${method}: ${message.error.message}`));
    else resolve(message.result);
  }
}

/** One page: what the tests do with it, and what went wrong in it. */
class Page {
  /** Uncaught exceptions, console errors and what the content security policy refused, in words. */
  troubles = [];
  #pipe;
  #session;

  constructor(pipe, session) {
    this.#pipe = pipe;
    this.#session = session;
    pipe.onEvent(({ method, params }) => {
      if (method === "Runtime.exceptionThrown") {
        this.troubles.push(params.exceptionDetails.exception?.description ?? params.exceptionDetails.text);
      } else if (method === "Log.entryAdded" && params.entry.level === "error") {
        this.troubles.push(`${params.entry.text} ${params.entry.url ?? ""}`.trim());
      } else if (method === "Runtime.consoleAPICalled" && params.type === "error") {
        this.troubles.push(params.args.map((arg) => arg.value ?? arg.description).join(" "));
      }
    });
  }

  #ask(method, params) {
    return this.#pipe.ask(method, params, this.#session);
  }

  async enable() {
    for (const domain of ["Page", "Runtime", "Log"]) await this.#ask(`${domain}.enable`);
  }

  async resize(width, height) {
    await this.#ask("Emulation.setDeviceMetricsOverride", { width, height, deviceScaleFactor: 1, mobile: false });
  }

  async open(url) {
    const { errorText } = await this.#ask("Page.navigate", { url });
    if (errorText) throw new Error(`${url}: ${errorText}`);
    await this.until("document.readyState === 'complete' && location.href !== 'about:blank'", `loading ${url}`);
  }

  /** The value of a JavaScript expression in the page; a promise is awaited. */
  async evaluate(expression) {
    const { result, exceptionDetails } = await this.#ask("Runtime.evaluate", {
      expression, awaitPromise: true, returnByValue: true,
    });
    if (exceptionDetails) throw new Error(exceptionDetails.exception?.description ?? exceptionDetails.text);
    return result.value;
  }

  /** Waits until the expression is true in the page. */
  async until(expression, what, seconds = 60) {
    const deadline = Date.now() + 1000 * seconds;
    while (!(await this.evaluate(expression))) {
      if (Date.now() > deadline) throw new Error(`waited ${seconds} s in vain: ${what}`);
      await sleep(50);
    }
  }

  async wheel(selector, deltaY) {
    const { x, y } = await this.#middleOf(selector);
    await this.#ask("Input.dispatchMouseEvent", { type: "mouseWheel", x, y, deltaX: 0, deltaY });
  }

  async click(selector) {
    const { x, y } = await this.#middleOf(selector);
    for (const type of ["mousePressed", "mouseReleased"]) {
      await this.#ask("Input.dispatchMouseEvent", { type, x, y, button: "left", clickCount: 1 });
    }
  }

  async press(key, text) {
    await this.#ask("Input.dispatchKeyEvent", { type: "keyDown", key, text });
    await this.#ask("Input.dispatchKeyEvent", { type: "keyUp", key });
  }

  /** Puts files into a file input. */
  async choose(selector, files) {
    const { root } = await this.#ask("DOM.getDocument", {});
    const { nodeId } = await this.#ask("DOM.querySelector", { nodeId: root.nodeId, selector });
    await this.#ask("DOM.setFileInputFiles", { nodeId, files });
  }

  /** The page as PNG bytes. */
  async screenshot() {
    const { data } = await this.#ask("Page.captureScreenshot", { format: "png" });
    return Buffer.from(data, "base64");
  }

  #middleOf(selector) {
    return this.evaluate(`(() => {
      const element = document.querySelector(${JSON.stringify(selector)});
      element.scrollIntoView({ block: "nearest" });
      const box = element.getBoundingClientRect();
      return { x: box.x + box.width / 2, y: box.y + box.height / 2 };
    })()`);
  }
}
