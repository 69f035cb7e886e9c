"""Write the pages of judgements: claims, certificates, growth with size, work-precision, frontier."""
