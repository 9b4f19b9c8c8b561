/**
 * Numbers for people.
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
 * An audited error: both numbers with as many digits as the uncertainty has meaning.
 * @param {{ rmse: number, std_error: number }} error
 */
export function auditedError({ rmse, std_error: uncertainty }) {
  const digits = uncertainty > 0 ? Math.min(6, Math.max(2, Math.ceil(-Math.log10(uncertainty)))) : 4;
  return `RMSE ${rmse.toFixed(digits)} ± ${uncertainty.toFixed(digits)}`;
}

/** What each `stats.reason` says to people. */
const REASONS = Object.freeze({
  device: 'the device needs longer for a full frame',
  link: 'the connection carries less',
});

/**
 * Why a moving picture is softer than wished; empty when it is not.
 * @param {string} reason `stats.reason`; one we do not know is shown as it is
 */
export const reasonText = (reason) => REASONS[/** @type {keyof typeof REASONS} */ (reason)] ?? reason;

/**
 * The resolution of a moving picture and what holds it down; empty at full resolution.
 * @param {{ scale: number, reason: string }} stats
 */
export function resolutionText({ scale, reason }) {
  if (scale >= 1) return '';
  const share = `${Math.round(scale * 100)} % resolution`;
  return reason ? `${share}: ${reasonText(reason)}` : share;
}

/**
 * A number for a text field: short, but exact enough to come back unchanged to the eye.
 * @param {number} value
 */
export function field(value) {
  if (value === 0) return '0';
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(3);
  return String(Number(value.toPrecision(5)));
}
