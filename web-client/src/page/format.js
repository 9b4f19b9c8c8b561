/**
 * Numbers as text.
 */

/** @param {number} value */
export const count = (value) => value.toLocaleString('en', { maximumFractionDigits: 0 });

/** @param {number} value */
export function bytes(value) {
  if (value < 1000) return `${Math.round(value)} B`;
  if (value < 1e6) return `${(value / 1e3).toFixed(value < 1e4 ? 1 : 0)} kB`;
  return `${(value / 1e6).toFixed(value < 1e7 ? 1 : 0)} MB`;
}

/** @param {number} value */
export const milliseconds = (value) => (value < 10 ? `${value.toFixed(1)} ms` : `${count(value)} ms`);

/**
 * A number with a number of significant digits, without an exponent for moderate sizes.
 * @param {number} value
 * @param {number} digits
 */
export function significant(value, digits) {
  if (value === 0) return '0';
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(digits - 1);
  return size >= 10 ** digits ? value.toFixed(0) : value.toPrecision(digits);
}

/** @param {number} share in [0, 1] */
export const percent = (share) => `${share === 0 || share >= 0.0995 ? Math.round(share * 100) : (share * 100).toFixed(1)} %`;

/** @param {number} length metres */
export function metres(length) {
  if (length >= 1) return `${significant(length, 3)} m`;
  return length >= 0.01 ? `${significant(length * 100, 2)} cm` : `${significant(length * 1000, 2)} mm`;
}

/**
 * An audited error: both numbers with the digits that the uncertainty justifies.
 * @param {{ rmse: number, std_error: number }} error
 */
export function auditedError({ rmse, std_error: uncertainty }) {
  const digits = uncertainty > 0 ? Math.min(6, Math.max(2, Math.ceil(-Math.log10(uncertainty)))) : 4;
  return `RMSE ${rmse.toFixed(digits)} ± ${uncertainty.toFixed(digits)}`;
}

/** User-visible text of each `stats.reason`. */
const REASONS = Object.freeze({
  device: 'the device cannot render full frames in time',
  link: 'the bandwidth of the connection is too low',
});

/**
 * Why resolution or quality of a moving image is reduced; empty if it is not.
 * @param {string} reason `stats.reason`; an unknown one is shown unchanged
 */
export const reasonText = (reason) => REASONS[/** @type {keyof typeof REASONS} */ (reason)] ?? reason;

/**
 * The resolution of a moving image and why it is reduced; empty at full resolution.
 * @param {{ scale: number, reason: string }} stats
 */
export function resolutionText({ scale, reason }) {
  if (scale >= 1) return '';
  const share = `${Math.round(scale * 100)} % resolution`;
  return reason ? `${share}: ${reasonText(reason)}` : share;
}

/**
 * A number for a text field, with five significant digits.
 * @param {number} value
 */
export function field(value) {
  if (value === 0) return '0';
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(3);
  return String(Number(value.toPrecision(5)));
}
