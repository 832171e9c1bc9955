function rounds(low, high, most) {  // at most so many round numbers from low to high, evenly apart
  if (!(high > low)) return [low];
  const ten = 10 ** Math.floor(Math.log10((high - low) / most));
  for (const step of [1, 2, 5, 10, 20].map(n => n * ten)) {
    const first = Math.ceil(low / step - 1e-9), count = Math.floor(high / step + 1e-9) - first + 1;
    if (count <= most) return Array.from({length: count}, (_, k) => Number(((first + k) * step).toPrecision(12)));
  }
  return [];
}
