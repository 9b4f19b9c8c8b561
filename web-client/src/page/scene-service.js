/**
 * The server's scenes over HTTP.
 */

/**
 * @typedef {object} Scene
 * @property {string} id `sha256:…`
 * @property {string} name
 * @property {number} triangle_count
 * @property {string} session
 * @property {string[]} warnings
 */

/** A failed request, with a user-visible message. */
export class ServiceError extends Error {
  name = 'ServiceError';
}

/** @param {string} session */
export const streamPath = (session) => `/v1/sessions/${encodeURIComponent(session)}/stream`;

/**
 * @returns {Promise<Scene[]>}
 * @throws {ServiceError}
 */
export async function listScenes() {
  let response;
  try {
    response = await fetch('/v1/scenes', { headers: { accept: 'application/json' } });
  } catch {
    throw new ServiceError('The server is not answering.');
  }
  const body = await response.text();
  if (!response.ok) throw new ServiceError(problemText(response.status, body));
  const scenes = parse(body)?.scenes;
  if (!Array.isArray(scenes)) throw new ServiceError('The list of scenes could not be read.');
  return scenes.filter(isScene);
}

/**
 * Uploads a GLB file.
 * @param {File} file
 * @param {(fraction: number) => void} progress 0 to 1 of the bytes sent
 * @param {AbortSignal} signal
 * @returns {Promise<Scene>}
 * @throws {ServiceError}
 */
export function uploadScene(file, progress, signal) {
  return new Promise((resolve, reject) => {
    // `fetch` does not report the progress of a request body.
    const request = new XMLHttpRequest();
    request.open('POST', `/v1/scenes?name=${encodeURIComponent(file.name.replace(/\.glb$/i, ''))}`);
    request.setRequestHeader('content-type', 'model/gltf-binary');
    request.upload.addEventListener('progress', (event) => {
      if (event.lengthComputable) progress(event.loaded / event.total);
    });
    request.addEventListener('load', () => {
      const scene = parse(request.responseText);
      if (request.status >= 200 && request.status < 300 && isScene(scene)) resolve(scene);
      else reject(new ServiceError(problemText(request.status, request.responseText)));
    });
    request.addEventListener('error', () => reject(new ServiceError('The connection broke during the upload. Please try again.')));
    request.addEventListener('abort', () => reject(new ServiceError('The upload was cancelled.')));
    signal.addEventListener('abort', () => request.abort(), { once: true });
    request.send(file);
  });
}

/**
 * The message of a refusal: that of the problem document, if there is one.
 * @param {number} status
 * @param {string} body
 */
export function problemText(status, body) {
  const problem = parse(body);
  const detail = typeof problem?.detail === 'string' ? problem.detail : '';
  const title = typeof problem?.title === 'string' ? problem.title : '';
  if (title && detail && !detail.toLowerCase().startsWith(title.toLowerCase())) return `${title}: ${detail}`;
  return detail || title || `The server answered with status ${status}.`;
}

/** @param {string} text */
function parse(text) {
  try {
    return JSON.parse(text);
  } catch {
    return undefined;
  }
}

/**
 * @param {any} value
 * @returns {value is Scene}
 */
function isScene(value) {
  return typeof value?.id === 'string' && typeof value.name === 'string' && typeof value.session === 'string';
}
