/**
 * Control messages: JSON objects distinguished by `t`. Their types are in `types.d.ts`, generated from `protocol/src`.
 */

import { faultOf } from './check.js';
import { definitions, messages } from './schema.js';

/** WebSocket subprotocol of this version. */
export const SUBPROTOCOL = 'surfelcast.v1.json';

/** Protocol version in `hello` and `welcome`. */
export const VERSION = 1;

/** A text message that is malformed. */
export class MessageError extends Error {
  name = 'MessageError';
}

/**
 * Parses a text message.
 * @param {string} text
 * @returns {import('./types.js').ServerMessage | undefined} nothing for a type that only newer servers send
 * @throws {MessageError} if it is malformed
 */
export function parseServerMessage(text) {
  let message;
  try {
    message = JSON.parse(text);
  } catch {
    throw new MessageError('message is not JSON');
  }
  const type = message?.t;
  if (typeof type !== 'string') throw new MessageError('message has no type `t`');
  const schema = Object.hasOwn(messages, type) ? messages[type] : undefined;
  if (!schema) return undefined;
  const fault = faultOf(message, schema, type, definitions);
  if (fault) throw new MessageError(fault);
  return message;
}
