/**
 * WebSocket close codes, and what each means to the user. Mirrors `protocol/src/close.rs`.
 */

export const close = Object.freeze({
  GOING_AWAY: 1001,
  POLICY: 1008,
  TOO_BIG: 1009,
  RESTART: 1012,
  TRY_LATER: 1013,
  MALFORMED: 4400,
  NO_SESSION: 4404,
  TOO_SLOW: 4408,
  SUPERSEDED: 4409,
  ENDED: 4410,
  VERSION: 4426,
  RATE: 4429,
  NO_CAPACITY: 4503,
  GPU_LOST: 4507,
});

/**
 * @typedef {object} Verdict
 * @property {'away' | 'full' | 'restarting' | 'gpu' | 'gone' | 'superseded' | 'outdated' | 'refused' | 'slow'} kind
 * @property {string} title
 * @property {string} detail
 * @property {boolean} retry whether to reconnect without user action
 * @property {number} minDelayMs least wait before the next attempt
 */

/** @type {Verdict} */
const AWAY = {
  kind: 'away',
  title: 'The render server is not answering',
  detail: 'Your camera and settings are kept here and will be restored.',
  retry: true,
  minDelayMs: 0,
};

/** @type {Verdict} */
const FULL = {
  kind: 'full',
  title: 'The render server is full',
  detail: 'All connections are in use. This page keeps trying and will join as soon as one is free.',
  retry: true,
  minDelayMs: 5000,
};

/** @type {Verdict} */
const RESTARTING = {
  kind: 'restarting',
  title: 'The render server is restarting',
  detail: 'It should be back shortly. Your camera is kept.',
  retry: true,
  minDelayMs: 500,
};

/** @type {Record<number, Verdict>} */
const VERDICTS = {
  [close.GOING_AWAY]: RESTARTING,
  [close.RESTART]: RESTARTING,
  [close.TRY_LATER]: FULL,
  [close.NO_CAPACITY]: FULL,
  [close.POLICY]: stop('refused', 'This page may not use the render server', 'Open the page from an address the server allows.'),
  [close.TOO_BIG]: stop('refused', 'The server refused a message as too large', 'Reload the page; if it happens again, please report it.'),
  [close.MALFORMED]: stop('refused', 'The page sent a message that the server could not read', 'Reload the page; if it happens again, please report it.'),
  [close.NO_SESSION]: stop('gone', 'This session no longer exists', 'Choose a scene to start a new one.'),
  [close.ENDED]: stop('gone', 'This session has ended', 'Choose a scene to start a new one.'),
  [close.SUPERSEDED]: stop('superseded', 'This view continues elsewhere', 'A newer connection has taken it over. You can resume it here.'),
  [close.VERSION]: stop('outdated', 'The server has been updated', 'Reload the page to get the matching version.'),
  [close.TOO_SLOW]: { ...AWAY, kind: 'slow', title: 'The connection was too slow', detail: 'Frames were not acknowledged in time. Reconnecting.', minDelayMs: 1000 },
  [close.RATE]: { ...AWAY, kind: 'slow', title: 'Too many messages', detail: 'The server limits the rate of messages. Reconnecting shortly.', minDelayMs: 5000 },
  [close.GPU_LOST]: { ...AWAY, kind: 'gpu', title: 'The graphics device failed', detail: 'The server lost its GPU and is recovering.', minDelayMs: 5000 },
};

/**
 * The meaning of a close code. An unknown code counts as "away", because reconnecting is harmless.
 * @param {number} code
 * @returns {Verdict}
 */
export function verdictOf(code) {
  return VERDICTS[code] ?? AWAY;
}

/**
 * @param {Verdict['kind']} kind
 * @param {string} title
 * @param {string} detail
 * @returns {Verdict}
 */
function stop(kind, title, detail) {
  return { kind, title, detail, retry: false, minDelayMs: 0 };
}
