"""How far planning scales: ``make scale`` grows one size at a time and prints seconds, memory and slope."""
