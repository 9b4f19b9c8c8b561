/* Runs only in browsers without modules; written in their dialect. */
document.addEventListener('DOMContentLoaded', function () {
  var plate = document.getElementById('away');
  plate.hidden = false;
  plate.innerHTML = '<strong>This browser is too old for this page</strong><span>A current Firefox, Chrome, Edge or Safari can show it.</span>';
});
