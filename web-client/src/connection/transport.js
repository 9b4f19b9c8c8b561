/**
 * The socket behind an interface, so that tests can replace it.
 */

/**
 * @typedef {object} TransportHandlers
 * @property {() => void} onOpen
 * @property {(text: string) => void} onText
 * @property {(message: ArrayBuffer) => void} onBinary
 * @property {(code: number, reason: string) => void} onClose called exactly once, never after `close()` of our own
 */

/**
 * @typedef {object} Transport
 * @property {(text: string) => void} send only between `onOpen` and `onClose`
 * @property {(code?: number, reason?: string) => void} close no handler is called after this
 */

/** @typedef {(url: string, subprotocol: string, handlers: TransportHandlers) => Transport} TransportFactory */

/**
 * Opens a browser WebSocket.
 * @type {TransportFactory}
 */
export function openWebSocket(url, subprotocol, handlers) {
  const socket = new WebSocket(absoluteSocketUrl(url), subprotocol);
  socket.binaryType = 'arraybuffer';
  let done = false;
  socket.addEventListener('open', () => {
    if (!done) handlers.onOpen();
  });
  socket.addEventListener('message', ({ data }) => {
    if (done) return;
    if (typeof data === 'string') handlers.onText(data);
    else handlers.onBinary(data);
  });
  // An `error` event is always followed by `close`, which carries all that is known of the cause.
  socket.addEventListener('close', ({ code, reason }) => {
    if (done) return;
    done = true;
    handlers.onClose(code, reason);
  });
  return {
    send: (text) => socket.send(text),
    close: (code = 1000, reason = '') => {
      done = true;
      socket.close(code, reason);
    },
  };
}

/**
 * `ws:` or `wss:` address of a path on the page's own server, or of an absolute address.
 * @param {string} url
 */
function absoluteSocketUrl(url) {
  const absolute = new URL(url, document.baseURI);
  if (absolute.protocol === 'http:') absolute.protocol = 'ws:';
  if (absolute.protocol === 'https:') absolute.protocol = 'wss:';
  return absolute.href;
}
