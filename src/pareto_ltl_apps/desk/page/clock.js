// Times in the zone of the browser, beside UTC.

const SHOWN = { hour: "2-digit", minute: "2-digit", hourCycle: "h23", timeZoneName: "short" };

/** ", 02:30 GMT+2 here" for a time of UTC in ISO 8601; nothing where the clock of the browser shows UTC. */
export function localText(time) {
  const moment = new Date(/Z|[+-]\d\d:?\d\d$/.test(time) ? time : `${time}Z`), away = -moment.getTimezoneOffset();
  if (!away || Number.isNaN(away)) return "";
  const days = Math.floor((moment.getTime() + away * 60000) / 86400000) - Math.floor(moment.getTime() / 86400000);
  return `, ${new Intl.DateTimeFormat("en-GB", SHOWN).format(moment)} here${days ? ` (${days > 0 ? "+" : "−"}1 day)` : ""}`;
}
