// Who looks at the page, and what they may do.

import { computed, signal } from "@preact/signals";

import type { Holder } from "../base/api.ts";

/** Null: not known yet, or nobody in particular. */
export const holder = signal<Holder | null>(null);

/** Whether what is stored may be changed; the server decides. */
export const mayWrite = computed(() => holder.value?.scopes.includes("write") ?? true);
