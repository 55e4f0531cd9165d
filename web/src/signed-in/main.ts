// Where the issuer leads back to after somebody has signed in.

import { h, setText } from "../base/dom.ts";
import { type Key, learn, t } from "../base/i18n.ts";
import { NoTokens } from "../base/session.ts";
import { NotSignedIn, enter, finish, handToOpener, takeAttempt } from "../base/sign-in.ts";
import { preferences } from "../store/preferences.ts";

// The answer leaves the address and the history of the browser before anything else happens.
const answer = new URLSearchParams(location.hash.replace(/^#/, ""));
history.replaceState(null, "", location.pathname);

/** How long to wait for the page that has opened this window, in ms. */
const OPENER_MS = 5000;

const message = h("p", { id: "message", role: "status" });

function say(key: Key, values: Readonly<Record<string, unknown>> = {}): void {
  setText(message, t(key, values));
}

async function follow(): Promise<void> {
  const attempt = takeAttempt(answer);
  if (!attempt) {
    if (!(await handToOpener(answer, OPENER_MS))) return say("signed-in.stray");
    say("signed-in.done");
    return window.close();
  }
  try {
    enter(await finish(attempt, answer));
  } catch (problem) {
    const reason = problem instanceof NotSignedIn || problem instanceof NoTokens ? problem.message : "";
    return say(reason ? "signed-in.failed" : "signed-in.silent", { reason });
  }
  const back = new URL(attempt.back, location.origin);
  location.replace(back.origin === location.origin ? back : "./");
}

async function build(): Promise<void> {
  const { language, theme } = preferences.peek();
  document.documentElement.dataset.theme = theme;
  await learn(language);
  document.documentElement.lang = language;
  document.body.append(
    h(
      "main",
      { class: "launch" },
      h("h1", {}, "Isocortex"),
      message,
      h("p", {}, h("a", { href: "./" }, t("launch.all"))),
    ),
  );
  say("signed-in.wait");
  await follow();
}

void build();
