"""Pages of judgements: claims, certificates, growth with size, work and precision, frontier."""
