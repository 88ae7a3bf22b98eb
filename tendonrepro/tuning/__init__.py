"""Controllers at their best: each law tuned on the same plants, and the laws compared in pairs."""
