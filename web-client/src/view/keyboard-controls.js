/**
 * The keyboard: arrows orbit (with Shift pan), + and - dolly, Home and digits go to viewpoints, F flies, Enter
 * inspects.
 */

import { dolly, orbit, pan } from './camera.js';

const STEP = (5 * Math.PI) / 180;
const PAN_STEP = 0.05;
const DOLLY_STEP = 1.1;

/** @type {Record<string, [number, number]>} right, up */
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/**
 * @param {HTMLElement} element that has the focus
 * @param {object} options
 * @param {import('./rig.js').Rig} options.rig
 * @param {import('./flight.js').Flight} options.flight
 * @param {import('./inspect-mode.js').InspectMode} options.inspect
 * @param {() => void} options.leaveInspect turns that mode off
 * @param {AbortSignal} options.signal ends all listening
 */
export function listenToKeyboard(element, { rig, flight, inspect, leaveInspect, signal }) {
  element.addEventListener(
    'keydown',
    (event) => {
      // Leave shortcuts of browser and system alone.
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (flight.press(event.code, event.shiftKey) || act(event)) event.preventDefault();
    },
    { signal },
  );
  element.addEventListener('keyup', (event) => flight.release(event.code, event.shiftKey), { signal });
  element.addEventListener('blur', () => flight.releaseAll(), { signal });

  /**
   * @param {KeyboardEvent} event
   * @returns {boolean} whether the key was used
   */
  function act(event) {
    const arrow = Object.hasOwn(ARROWS, event.key) ? ARROWS[event.key] : undefined;
    if (arrow) {
      const [right, up] = arrow;
      if (event.shiftKey) rig.burst(pan(rig.pose, right * PAN_STEP, up * PAN_STEP));
      else rig.burst(orbit(rig.pose, right * STEP, up * STEP));
      return true;
    }
    if (/^[0-9]$/.test(event.key)) {
      rig.goToPreset(Number(event.key));
      return true;
    }
    switch (event.key) {
      case '+':
      case '=':
        rig.burst(dolly(rig.pose, 1 / DOLLY_STEP, rig.nearest));
        return true;
      case '-':
      case '_':
        rig.burst(dolly(rig.pose, DOLLY_STEP, rig.nearest));
        return true;
      case 'Home':
        rig.goTo(rig.home);
        return true;
      case 'f':
      case 'F':
        if (!event.repeat) flight.setMode(!flight.mode);
        return true;
      case 'Enter':
        if (!inspect.on) return false;
        if (!event.repeat) inspect.request({ x: 0.5, y: 0.5 });
        return true;
      case 'Escape':
        if (flight.mode) flight.setMode(false);
        else if (inspect.on) leaveInspect();
        else return false;
        return true;
      default:
        return false;
    }
  }
}
